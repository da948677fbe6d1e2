# SPDX-License-Identifier: GPL-2.0-or-later
"""A network segment between two guests, with a relay that drops and duplicates packets of the stream in both
directions, by a seed."""
from __future__ import annotations

import dataclasses
import pathlib
import random
import selectors
import socket
import threading

MEDIA, REPORTS, REPAIR = 8000, 8001, 8002  # the stream's ports
ETHERTYPE, PROTOCOL, HEADER = 12, 23, 14  # offsets in an Ethernet frame with IPv4


def stream_port(frame: bytes) -> int | None:
    """The stream's port that a frame (UDP over IPv4) goes to; None for other frames."""
    if frame[ETHERTYPE:HEADER] != b"\x08\x00" or frame[PROTOCOL] != 17:
        return None
    udp = HEADER + 4 * (frame[HEADER] & 15)
    port = int.from_bytes(frame[udp + 2:udp + 4], "big")
    return port if port in (MEDIA, REPORTS, REPAIR) else None


@dataclasses.dataclass
class Flow:
    """Packets to one port."""
    came: int = 0
    dropped: int = 0
    duplicated: int = 0

    @property
    def passed(self) -> int:
        return self.came - self.dropped + self.duplicated


class Segment:
    """Connects two guests' network cards. Only the stream's packets may be dropped or duplicated."""

    def __init__(self, folder: pathlib.Path, seed: str, drop: float, duplicate: float) -> None:
        self.folder, self.random = folder, random.Random(seed)
        self.drop, self.duplicate = drop, duplicate  # percent
        self.bad = False       # whether packets are dropped and duplicated now
        self.media, self.reports, self.repair = Flow(), Flow(), Flow()
        self._flows = {MEDIA: self.media, REPORTS: self.reports, REPAIR: self.repair}
        self._selector = selectors.DefaultSelector()
        self._sockets = []
        for end in range(2):
            one = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
            path = folder / f"relay{end}"
            path.unlink(missing_ok=True)
            one.bind(str(path))
            one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 << 20)
            self._sockets.append(one)
            self._selector.register(one, selectors.EVENT_READ, end)
        self._ended = False
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def card(self, end: int) -> tuple[str, ...]:
        """QEMU's options for the card at this end."""
        (self.folder / f"guest{end}").unlink(missing_ok=True)
        places = [f"local.type=unix,local.path={self.folder}/guest{end}",
                  f"remote.type=unix,remote.path={self.folder}/relay{end}"]
        return ("-netdev", ",".join(["dgram,id=net", *places]),
                "-device", f"virtio-net-pci,netdev=net,mac=52:54:00:00:00:0{end + 1}")

    def _go(self, end: int, frame: bytes) -> None:
        try:
            self._sockets[end].sendto(frame, str(self.folder / f"guest{end}"))
        except OSError:
            pass  # no receiver now

    def _relay(self, end: int, frame: bytes) -> None:
        port = stream_port(frame)
        if port is not None:
            flow = self._flows[port]
            flow.came += 1
            if self.bad and self.random.uniform(0, 100) < self.drop:
                flow.dropped += 1
                return
            if self.bad and self.random.uniform(0, 100) < self.duplicate:
                flow.duplicated += 1
                self._go(1 - end, frame)
        self._go(1 - end, frame)

    def _run(self) -> None:
        while not self._ended:
            for key, _ in self._selector.select(0.1):
                self._relay(key.data, self._sockets[key.data].recv(65536))

    def end(self) -> None:
        self._ended = True
        self._thread.join()
        for one in self._sockets:
            one.close()
