# SPDX-License-Identifier: GPL-2.0-or-later
"""A shell in the guest over one of QEMU's consoles: run a command, get its exit status and output.

A console is a socket, or a pair of pipes, PATH.in and PATH.out. QEMU drops what a console's socket or pipe has no room
for. The kernel's hvc driver writes 16 bytes at a time, and each of these writes takes more than 1 KB of a socket's
buffer, so 4 KB of output on a busy host are enough to lose a part. A pipe of 1 MB takes 1 MB.
"""
import fcntl
import os
import pathlib
import re
import select
import socket
import time

from parts.common import PATIENCE

# The guest's side: reads a number and a line, runs the line, and prints an end mark with the number, since the answer
# to an abandoned command may arrive during the next one. The quotes keep an echo of this line from being a mark.
SERVER = ("stty -echo -onlcr; while read -r ddx_n ddx_c; do eval \"$ddx_c\" < /dev/null; "
          "printf '\\n@E''ND %s %d@\\n' \"$ddx_n\" $?; done")
END = re.compile(rb"\n?@END (\d+) (\d+)@\r?\n")


class Timeout(Exception):
    pass


ROOM = 1 << 20  # bytes of a pipe; the most that each user may ask for


def make_pipes(path: pathlib.Path) -> None:
    """Make empty pipes of a console, before QEMU is started with `-chardev pipe,path=PATH`."""
    for name in (f"{path}.in", f"{path}.out"):
        pathlib.Path(name).unlink(missing_ok=True)
        os.mkfifo(name, 0o600)


class Channel:
    def __init__(self, path: pathlib.Path) -> None:
        self.path = path
        self._buffer = b""
        self._commands = 0
        self._socket = None if pathlib.Path(f"{path}.in").exists() else socket.socket(socket.AF_UNIX)
        if self._socket:
            self._socket.connect(str(path))
            self._socket.setblocking(False)
            self._in = self._out = self._socket.fileno()
        else:
            self._in = os.open(f"{path}.in", os.O_WRONLY | os.O_NONBLOCK)
            self._out = os.open(f"{path}.out", os.O_RDONLY | os.O_NONBLOCK)
            fcntl.fcntl(self._out, fcntl.F_SETPIPE_SZ, ROOM)

    def close(self) -> None:
        if self._socket:
            self._socket.close()
        else:
            os.close(self._in)
            os.close(self._out)

    def send(self, text: str) -> None:
        """Send text unchanged; use begin() or run() with a shell that serves commands."""
        left, deadline = text.encode(), time.monotonic() + PATIENCE
        while left:
            if not select.select([], [self._in], [], max(0.0, deadline - time.monotonic()))[1]:
                raise Timeout(f"{self.path.name}: the guest does not read")
            left = left[os.write(self._in, left):]

    def _receive(self, deadline: float) -> None:
        left = deadline - time.monotonic()
        if left <= 0:
            raise Timeout(f"{self.path.name}: nothing more came after {self._buffer[-300:]!r}")
        if not select.select([self._out], [], [], left)[0]:
            return
        data = os.read(self._out, 65536)
        if not data:
            raise Timeout(f"{self.path.name}: the guest has gone")
        self._buffer += data

    def wait(self, pattern: bytes | re.Pattern[bytes], timeout: float = PATIENCE) -> re.Match[bytes]:
        """Wait for a pattern in what the guest prints; drops everything up to its end."""
        deadline = time.monotonic() + timeout
        while not (match := re.search(pattern, self._buffer)):
            self._receive(deadline)
        self._buffer = self._buffer[match.end():]
        return match

    def open_shell(self, timeout: float) -> None:
        """Wait until a shell answers, and turn it into a server of commands."""
        deadline = time.monotonic() + timeout
        while True:
            # Probes may fill the socket or pipe before the guest is up; dropping one is harmless.
            try:
                os.write(self._in, b"\necho rea''dy\n")
            except BlockingIOError:
                pass
            except ConnectionError:
                raise Timeout(f"{self.path.name}: the guest has gone") from None
            try:
                self.wait(rb"ready\r?\n", 0.3)
                break
            except Timeout:
                if time.monotonic() > deadline:
                    raise
        self.send(SERVER + "\n")
        self.run(":", deadline - time.monotonic())  # answers to earlier probes come before this one's

    def begin(self, command: str) -> None:
        """Start a command without waiting for its end, for example one that stops the machine."""
        self._commands += 1
        self.send(f"{self._commands} " + command.replace("\n", " ") + "\n")

    def run(self, command: str, timeout: float = PATIENCE) -> tuple[int, str]:
        self.begin(command)
        deadline = time.monotonic() + timeout
        while True:
            while not (match := END.search(self._buffer)):
                self._receive(deadline)
            text = self._buffer[:match.start()]
            self._buffer = self._buffer[match.end():]
            if int(match[1]) == self._commands:
                return int(match[2]), text.replace(b"\r", b"").decode(errors="replace")

    @property
    def raw(self) -> socket.socket:
        assert self._socket
        return self._socket
