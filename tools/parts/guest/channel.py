# SPDX-License-Identifier: GPL-2.0-or-later
"""A shell in the guest over one of QEMU's console sockets: run a command, get its exit status and output."""
import pathlib
import re
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


class Channel:
    def __init__(self, path: pathlib.Path) -> None:
        self.path = path
        self._socket = socket.socket(socket.AF_UNIX)
        self._socket.connect(str(path))
        self._buffer = b""
        self._commands = 0

    def close(self) -> None:
        self._socket.close()

    def send(self, text: str) -> None:
        """Send text unchanged; use begin() or run() with a shell that serves commands."""
        self._socket.settimeout(PATIENCE)  # instead of the rest of the last wait
        try:
            self._socket.sendall(text.encode())
        except TimeoutError:
            raise Timeout(f"{self.path.name}: the guest does not read") from None

    def _receive(self, deadline: float) -> None:
        left = deadline - time.monotonic()
        if left <= 0:
            raise Timeout(f"{self.path.name}: nothing more came after {self._buffer[-300:]!r}")
        self._socket.settimeout(left)
        try:
            data = self._socket.recv(65536)
        except TimeoutError:
            return
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
            # Probes may fill the socket before the guest is up; dropping one is harmless.
            self._socket.settimeout(0)
            try:
                self._socket.send(b"\necho rea''dy\n")
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
        return self._socket
