# SPDX-License-Identifier: GPL-2.0-or-later
"""QEMU's monitor (QMP): commands and events."""
import json
import pathlib
import socket
import time
from typing import Any

from parts.common import PATIENCE, Closing, Failed


class NotListening(Failed):
    """No program listens at the socket."""


class Monitor(Closing):
    """A connection, of which QEMU serves one at a time. All answers must come within `patience` seconds."""

    def __init__(self, path: pathlib.Path, patience: float = PATIENCE) -> None:
        self._patience = patience
        self._end = time.monotonic() + patience
        self._buffer = b""
        self._socket = socket.socket(socket.AF_UNIX)
        try:
            self._socket.settimeout(patience)
            self._socket.connect(str(path))
            self.execute("qmp_capabilities")
        except OSError as error:
            self._socket.close()
            kind = NotListening if isinstance(error, (ConnectionRefusedError, FileNotFoundError)) else Failed
            raise kind(f"QEMU: {error}") from None
        except Failed:
            self._socket.close()
            raise

    def end(self) -> None:
        self._socket.close()

    def _receive(self, what: str) -> dict[str, Any]:
        while b"\n" not in self._buffer:
            self._socket.settimeout(max(0.001, self._end - time.monotonic()))
            try:
                data = self._socket.recv(65536)
            except TimeoutError:
                raise Failed(f"QEMU: {what}: nothing came within {self._patience:.0f} s") from None
            if not data:
                raise Failed(f"QEMU: {what}: QEMU has gone")
            self._buffer += data
        line, _, self._buffer = self._buffer.partition(b"\n")
        return dict(json.loads(line))

    def execute(self, command: str, **arguments: object) -> None:
        self._socket.sendall(json.dumps({"execute": command, "arguments": arguments}).encode() + b"\n")
        while "event" in (answer := self._receive(command)) or "QMP" in answer:
            pass
        if "error" in answer:
            raise Failed(f"QEMU: {command}: {answer['error']}")

    def wait_for(self, event: str) -> None:
        """RESET, WATCHDOG, SHUTDOWN ..."""
        while self._receive(event).get("event") != event:
            pass
