# SPDX-License-Identifier: GPL-2.0-or-later
"""A robot and its operators, each in its own network namespace, with a lossy link between them.

    with Link(operators=2, loss=Iid(0.3), delay_ms=2, seed=7) as link:
        link.operator[0].popen(["ddxdecode", ...])
        link.robot.popen(["ddxvideosend", ...])
        link.counts().down[0].bytes

`down` is from the robot to an operator, `up` the return path. The link decides on each UDP packet, for a multicast
packet separately for each operator; other packets, such as ARP and IGMP, pass. Operators do not see each other, unless
they `meet`: then nothing is lost or counted. The namespaces exist as long as the link or a program in them.
"""
from __future__ import annotations

import dataclasses
import json
import os
import pathlib
import subprocess
import sys
from collections.abc import Callable, Mapping
from typing import Any

from parts.common import MORTAL, SBIN, TOP, Command
from parts.link import loss
from parts.link.relay import HOST, Flow
from parts.processes import Client


@dataclasses.dataclass(frozen=True)
class Node:
    """One end of the link. `inside` goes before a command."""
    address: str
    inside: tuple[str, ...]

    def popen(self, words: Command, **options: Any) -> subprocess.Popen[str]:
        return subprocess.Popen([*MORTAL, *self.inside, *words], text=True, **options)

    def run(self, words: Command, **options: Any) -> subprocess.CompletedProcess[str]:
        return subprocess.run([*MORTAL, *self.inside, *words], text=True, check=True, **options)


@dataclasses.dataclass(frozen=True)
class Way:
    """One direction of one operator."""
    ports: dict[int, Flow]  # by UDP port of the destination
    peak: int               # most bytes in any second
    did: dict[str, int]     # packets of each fault

    def total(self, what: Callable[[Flow], int]) -> int:
        return sum(map(what, self.ports.values()))

    @property
    def packets(self) -> int:
        return self.total(lambda flow: flow.packets)

    @property
    def bytes(self) -> int:
        return self.total(lambda flow: flow.bytes)

    @property
    def lost(self) -> int:
        return self.total(lambda flow: flow.lost)

    @property
    def delivered(self) -> int:
        return self.total(lambda flow: flow.delivered)


@dataclasses.dataclass(frozen=True)
class Counts:
    down: list[Way]
    up: list[Way]
    late_ms: float  # longest wait of a packet beyond the delay, because the machine was busy
    overrun: int    # packets that the relay was too slow to read; the other counts lack these


def counted(ways: list[dict[str, Any]]) -> list[Way]:
    return [Way({int(port): Flow(**flow) for port, flow in way["ports"].items()}, way["peak"], way["did"])
            for way in ways]


class Link:
    """`back`: the loss of the return path, if it differs from `loss`."""

    def __init__(self, operators: int = 1, loss: loss.Pattern = loss.NOTHING, delay_ms: float = 0, seed: int = 1,
                 back: loss.Pattern | None = None, meet: bool = False) -> None:
        self._words = [str(operators), str(delay_ms), str(seed), *(["meet"] if meet else [])]
        self.delay_ms, self._operators, self._loss, self._back = delay_ms, operators, loss, back

    def __enter__(self) -> Link:
        user = [] if os.geteuid() == 0 else ["unshare", "--map-root-user"]
        command = [*user, *MORTAL, sys.executable, "-B", "-m", "parts.link.relay", *self._words]
        self.relay = Client(command, cwd=TOP / "tools", env={**os.environ, **SBIN})
        process = pathlib.Path(f"/proc/{self.relay.process.pid}")
        enter = ["nsenter", *([f"--user={process}/ns/user", "--preserve-credentials"] if user else [])]
        nodes = [Node(f"{HOST}{number}", (*enter, f"--net={process}/fd/{namespace}"))
                 for number, namespace in enumerate(json.loads(self.relay.line()), 1)]
        self.robot, self.operator = nodes[0], nodes[1:]
        self.lose(self._loss, self._back)
        return self

    def __exit__(self, *_: object) -> None:
        self.relay.process.communicate()

    def lose(self, pattern: loss.Pattern, back: loss.Pattern | None = None, operator: int | None = None) -> None:
        """Change the loss for one operator or for all; the pattern begins with the next packet."""
        self.turn({"drop": pattern}, {"drop": pattern if back is None else back}, operator)

    def turn(self, down: Mapping[str, loss.Pattern], up: Mapping[str, loss.Pattern],
             operator: int | None = None) -> None:
        """Change the faults (parts.link.faults), each with the pattern of the packets that suffer it."""
        turned = [[one, direction, {name: loss.pack(pattern) for name, pattern in faults.items()}]
                  for one in range(self._operators) if operator in (None, one)
                  for direction, faults in (("down", down), ("up", up))]
        self.relay.ask(json.dumps({"turn": turned}))

    def counts(self) -> Counts:
        found = self.relay.ask(json.dumps({"counts": True}))
        return Counts(counted(found["down"]), counted(found["up"]), found["late_ms"], found["overrun"])
