# SPDX-License-Identifier: GPL-2.0-or-later
"""Child processes: stopped, measured, or asked line by line."""
import contextlib
import json
import os
import pathlib
import subprocess
from typing import Any

from parts.common import Command, Failed


def kill(process: subprocess.Popen[Any]) -> None:
    process.kill()
    process.wait()


def stop(process: subprocess.Popen[Any], patience: float = 5) -> None:
    """Terminate it; kill it if it still runs after `patience` seconds."""
    process.terminate()
    try:
        process.wait(patience)
    except subprocess.TimeoutExpired:
        kill(process)


def _fields(pid: int) -> list[str]:
    """The fields of a process's line in /proc, from its state on."""
    return pathlib.Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()


def seconds(pid: int) -> float:
    """The processor time of a running process, in s; 0 if there is none."""
    try:
        fields = _fields(pid)
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")  # user and system


def listing() -> str:
    """A line for each process: its number, its parent's, its state, where it waits in the kernel, and its command."""
    lines = []
    for pid in sorted(int(name) for name in os.listdir("/proc") if name.isdigit()):
        with contextlib.suppress(OSError):
            state, parent = _fields(pid)[:2]
            command = pathlib.Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
            waits = pathlib.Path(f"/proc/{pid}/wchan").read_text()
            if command:  # the kernel's own have none
                lines.append(f"{pid:>7} {parent:>7} {state} {waits:20} {command}")
    return "\n".join(lines)


class Client:
    """A program that answers each line of standard input with a line of JSON."""

    def __init__(self, command: Command, **options: Any) -> None:
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, **options)

    def line(self) -> str:
        assert self.process.stdout
        if not (line := self.process.stdout.readline()):
            raise Failed(f"{self.process.args!r} has stopped")
        return str(line.strip())

    def say(self, text: object = "") -> None:
        assert self.process.stdin
        self.process.stdin.write(f"{text}\n")
        self.process.stdin.flush()

    def ask(self, text: object = "") -> Any:
        self.say(text)
        return json.loads(self.line())

    def end(self) -> None:
        self.process.kill()
        self.process.communicate()
