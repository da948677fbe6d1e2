# SPDX-License-Identifier: GPL-2.0-or-later
"""Programs of the desk build for benchmarks: a store and its clients, their counters and CPU time."""
from __future__ import annotations

import json
import os
import pathlib
import subprocess
import sys
from collections.abc import Sequence
from typing import Any

from parts import processes
from parts.common import MORTAL, OUTPUT, TOP, Closing, output
from parts.image import native


class Programs(Closing):
    """A store and its clients, in a folder; they stop together. `inside`: words before each command, to enter a network
    namespace."""

    def __init__(self, folder: pathlib.Path, inside: Sequence[str] = ()) -> None:
        root = OUTPUT / "desk/root"
        self.folder, self.inside = folder, inside
        self.bin = root / "usr/bin"
        self.environment = {**os.environ, **native.environment(root), "DDX_DIR": str(folder)}
        self.running: list[subprocess.Popen[bytes]] = []
        self.start("ddxstore", "-m", "64M")

    def start(self, name: str, *words: str) -> subprocess.Popen[bytes]:
        command = [*MORTAL, *self.inside, str(self.bin / name), *words]
        with open(self.folder / f"errors-{len(self.running)}-{pathlib.Path(name).name}", "w") as errors:
            process = subprocess.Popen(command, env=self.environment, stdout=subprocess.DEVNULL, stderr=errors,
                                       cwd=self.folder)
        self.running.append(process)
        return process

    def watch(self, item: str, pictures: pathlib.Path | None = None) -> Watcher:
        command = [*MORTAL, sys.executable, "-B", "-m", "bench.watch", item]
        command += [str(pictures)] if pictures else []
        environment = {**self.environment, "PYTHONPATH": f"{TOP}/package/ddx/python:{TOP}/tools:{TOP}"}
        return Watcher(subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True))

    def _counters(self, instance: str) -> list[dict[str, Any]]:
        """The counters of an instance; none before it runs."""
        lines = output([self.bin / "ddxctl", "stats", "-json"], self.environment).splitlines()
        return [one for one in map(json.loads, lines) if one["instance"] == instance]

    def answers(self, instance: str) -> bool:
        return bool(self._counters(instance))

    def count(self, instance: str, what: str) -> int:
        """One of a program's counters; 0 before it runs."""
        return sum(int(one[what]) for one in self._counters(instance))

    def lost(self, instance: str) -> int:
        """Frames that a program lost, for all reasons."""
        return sum(sum(one["lost"].values()) for one in self._counters(instance))

    def end(self) -> None:
        for process in reversed(self.running):
            process.terminate()
            process.wait(10)


class Watcher:
    """Reads the number in each picture of an item, see bench/watch.py."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self.process = process

    def stop(self) -> list[tuple[int | None, int]]:
        """[number in the picture, ns of the write] of all pictures."""
        self.process.terminate()
        return [(number, written) for number, written in json.loads(self.process.communicate(timeout=60)[0])]


def cpu_seconds(process: subprocess.Popen[bytes]) -> float:
    """CPU time of all threads of the process, finished ones included."""
    tasks = pathlib.Path(f"/proc/{process.pid}/task").iterdir()
    exact = sum(float((task / "schedstat").read_text().split()[0]) for task in tasks) / 1e9
    return max(exact, processes.seconds(process.pid))
