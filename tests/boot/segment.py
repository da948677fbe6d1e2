# SPDX-License-Identifier: GPL-2.0-or-later
"""A network segment between two guests' cards. Its ways lose and double UDP packets as those of parts.link do; other
frames pass."""
from __future__ import annotations

import pathlib
import random
import selectors
import socket
import threading
import time

from parts.link import loss
from parts.link.relay import ETHERNET, Flow, Way, udp_port

MEDIA, REPORTS, REPAIR = 8000, 8001, 8002  # the stream's ports


class Segment:
    """Only the stream's packets may be lost or doubled, and only while the segment is bad."""

    def __init__(self, folder: pathlib.Path, seed: str, lost: float = 0, doubled: float = 0) -> None:
        self.folder, self.seed = folder, seed
        self._bad = loss.Iid(lost), loss.Iid(doubled)
        self._ways = [Way(1), Way(0)]  # by the end that a frame comes from
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

    def turn(self, bad: bool) -> None:
        """Switch the losses on or off."""
        for end, way in enumerate(self._ways):
            patterns = self._bad if bad else (loss.NOTHING, loss.NOTHING)
            way.lose(*(one.judge(random.Random(f"{self.seed} {end} {which}")) for which, one in enumerate(patterns)))

    def flow(self, port: int) -> Flow:
        """All packets to this port, which are of one direction."""
        return next((way.flows[port] for way in self._ways if port in way.flows), Flow())

    def _relay(self, end: int, frame: bytes) -> None:
        way, port, packets = self._ways[end], udp_port(frame), [frame]
        if port in (MEDIA, REPORTS, REPAIR):
            packets, _ = way.take(port, frame, len(frame) - ETHERNET, time.monotonic())
        for frame in packets:
            try:
                self._sockets[way.target].sendto(frame, str(self.folder / f"guest{way.target}"))
            except OSError:
                continue  # no receiver now
            if port in way.flows:
                way.arrived(port, len(frame) - ETHERNET)

    def _run(self) -> None:
        while not self._ended:
            for key, _ in self._selector.select(0.1):
                self._relay(key.data, self._sockets[key.data].recv(65536))

    def end(self) -> None:
        self._ended = True
        self._thread.join()
        for one in self._sockets:
            one.close()
