# SPDX-License-Identifier: GPL-2.0-or-later
"""Devices on a robot's first serial line: a GPS and an IMU that send from power-on."""
import contextlib
import os
import pathlib
import random
import select
import socket
import threading
import time
from collections.abc import Iterator

from parts.guest.qemu import USERSPACE, Guest

PAUSE = 0.2       # s
BURST = 2000      # bytes, at once
SENTENCE = b"$GPGGA,092750.000,5321.6802,N,00630.3372,W,1,8,1.03,61.7,M,55.2,M,,*76\r\n"
POSITION = b"\xb5\x62\x01\x07\x5c\x00"  # UBX-NAV-PVT, followed by 92 arbitrary bytes
KEYS = b"\x03\x04\x13\x1a\x1c\x1b[B\r\n"   # Ctrl-C, -D, -S, -Z, -\\, an arrow key: a terminal's commands
LOGIN = b"\nroot\n\necho al''ive\n"


class Noise:
    """Sends on the guest's serial line until close(). Bytes that the line does not take are lost, as on a wire.

    Before userspace runs it sends no Enter, which would choose an entry in GRUB's menu. With UEFI it sends nothing
    until then: QEMU's firmware reads the line as a keyboard for its setup and for GRUB, and cannot be told otherwise,
    unlike a board's (docs/boards.md)."""

    def __init__(self, path: pathlib.Path, firmware: str) -> None:
        self.path = path
        self.from_power_on = firmware == "bios"
        self.sent = 0  # messages
        self.before = 0  # messages before userspace
        self._received = b""
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._end.set()
        self._thread.join()

    def _message(self, chance: random.Random) -> bytes:
        if USERSPACE not in self._received:
            if not self.from_power_on:
                return b""
            self.before += 1
            return (POSITION + bytes(94)) * 20
        return SENTENCE + POSITION + chance.randbytes(94) + KEYS + chance.randbytes(BURST) + LOGIN

    def _run(self) -> None:
        with contextlib.suppress(PermissionError):  # run before QEMU on a busy host, see _read()
            os.sched_setscheduler(threading.get_native_id(), os.SCHED_RR, os.sched_param(1))
        chance = random.Random(1)
        while not self._end.is_set():
            # A machine that starts again has a new socket.
            with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX) as line:
                line.connect(str(self.path))
                line.setblocking(False)
                while not self._end.is_set():
                    with contextlib.suppress(BlockingIOError):
                        line.send(self._message(chance))
                        self.sent += 1
                    if not self._read(line):
                        break
            self._end.wait(PAUSE)

    def _read(self, line: socket.socket) -> bool:
        """Read for PAUSE seconds; false: disconnected. Reads at once: QEMU sends single bytes, about 270 of them fill
        the socket, and its serial line then loses some bytes and repeats others."""
        end = time.monotonic() + PAUSE
        while (left := end - time.monotonic()) > 0:
            if select.select([line], [], [], left)[0]:
                data = line.recv(65536)
                if not data:
                    return False
                if USERSPACE not in self._received:
                    self._received += data
        return True


@contextlib.contextmanager
def noisy(guest: Guest, firmware: str) -> Iterator[Noise]:
    noise = Noise(guest.folder / "ttyS0", firmware)
    try:
        yield noise
    finally:
        noise.close()
