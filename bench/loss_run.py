# SPDX-License-Identifier: GPL-2.0-or-later
"""One run of a peer over a lossy link, with loss from the first packet on, and its figures."""
from __future__ import annotations

import dataclasses
import math
import pathlib
import time
from collections.abc import Callable
from typing import Any

from bench.clips import pictures
from bench.loss_figures import View, figures, longest_pause, mean, usable_at
from bench.loss_peers import Peer
from parts.common import Failed, scratch
from parts.link.link import Link, Way
from parts.link.loss import ALL, NOTHING, Bursts, EveryThird, Iid, Outages, Pattern

SECONDS = 60.0  # of the clip
SETTLED = 2.0  # s after the first frame: start of the measurement
JOIN = 2.0  # s after the first frame: a receiver joins
TAIL = 5  # frames
PAUSE_MS, LATE_MS = 120, 20
CLEAN = "clean"
COLUMNS: dict[str, Pattern] = {"every 3rd": EveryThird(), "iid 10": Iid(0.1), "iid 30": Iid(0.3),
                               "bursts of 5": Bursts(0.3, 5), "outages": Outages(0.3, 40),
                               "outages together": Outages(0.3, 40, together=True)}
Maker = Callable[[Link, pathlib.Path, pathlib.Path, "Case"], Peer]


@dataclasses.dataclass(frozen=True)
class Case:
    """`reports`: the return path works. `join`: the receiver starts during the clip. `options`: of our sender."""
    peer: str
    column: str
    clip: str
    seed: int = 1
    reports: bool = True
    rtt_ms: float = 4
    operators: int = 1
    join: bool = False
    options: str = ""

    @property
    def reference(self) -> tuple[object, ...]:
        """Cases with the same reference share a run without loss."""
        return self.peer, self.clip, self.reports, self.rtt_ms, self.operators, self.options

    @property
    def clean(self) -> Case:
        return dataclasses.replace(self, column=CLEAN, seed=1, join=False)

    def __str__(self) -> str:
        way = ("reports" if self.reports else "one-way") + (f", {self.options}" if self.options else "")
        return (f"{self.peer}, {self.column}, {self.clip}, {way}, RTT {self.rtt_ms:g} ms, seed {self.seed}"
                + (f", {self.operators} operators" if self.operators > 1 else "") + (", join" if self.join else ""))


@dataclasses.dataclass(frozen=True)
class Plan:
    """Times of a run, s after the first frame."""
    seconds: float = SECONDS
    settled: float = SETTLED


@dataclasses.dataclass
class Take:
    case: Case
    views: list[View]
    joined: int  # ns
    settled: int
    wire: dict[str, float]

    def frames(self) -> list[int]:
        """The measured frames, without the last ones, which a program may hold back until the next frame."""
        numbers = [number for number, written in sorted(self.views[0].written.items()) if written >= self.settled]
        return numbers[:-TAIL]

    def pause_ms(self) -> float:
        """The longest time between two of the robot's measured frames. Before them a peer may wait for its connection,
        which takes SRT most of a second where packets are lost."""
        return longest_pause([written for written in self.views[0].written.values() if written >= self.settled])

    def disturbed(self) -> bool:
        """Whether the machine was too busy: frames of the robot or packets of the relay were late, or none came."""
        return (not self.frames() or self.pause_ms() > PAUSE_MS or self.wire["late_ms"] > LATE_MS
                or self.wire["overrun"] > 0)


def rate(before: Way, after: Way, seconds: float) -> float:
    """kbit/s, IP and UDP headers included"""
    return 8 * (after.bytes - before.bytes) / seconds / 1000


def take(case: Case, maker: Maker, clip: pathlib.Path, plan: Plan) -> Take:
    pattern = COLUMNS.get(case.column, NOTHING)
    back = pattern if case.reports else ALL
    with (scratch() as folder,
          Link(case.operators, delay_ms=case.rtt_ms / 2, seed=case.seed, loss=pattern, back=back) as link,
          maker(link, clip, folder, case) as peer):
        return _take(case, peer, link, clip, plan)


def _take(case: Case, peer: Peer, link: Link, clip: pathlib.Path, plan: Plan) -> Take:
    begin = 0.0

    def sleep_until(second: float) -> int:
        time.sleep(max(0.0, begin + second - time.monotonic()))
        return time.monotonic_ns()

    if not case.join:
        peer.receive()
    peer.send()
    peer.play()
    begin = time.monotonic()
    joined = sleep_until(JOIN if case.join else 0)
    if case.join:
        peer.receive()
        joined = time.monotonic_ns()
    settled = sleep_until(JOIN + 1 if case.join else plan.settled)
    before, begin_wire = link.counts(), time.monotonic()
    sleep_until(plan.seconds)
    after, seconds = link.counts(), time.monotonic() - begin_wire
    source, written = pictures(clip), peer.written()
    views = [View(source, written, shown, peer.deadline_ms) for shown in peer.shown()]
    wire = {"wire_kbit": rate(before.down[0], after.down[0], seconds),
            "wire_peak_kbit": max(way.peak for way in after.down) * 8 / 1000,
            "back_kbit": mean([rate(*ways, seconds) for ways in zip(before.up, after.up)]),
            "late_ms": after.late_ms, "overrun": after.overrun}
    return Take(case, views, joined, settled, wire)


def judge(found: Take, clean: dict[int, float]) -> dict[str, Any]:
    """The figures of a run: the mean of all operators, and usable frames and longest time of the worst one."""
    frames = found.frames()
    if not frames:
        raise Failed("the robot wrote no frame while the link was measured; is this machine too busy?")
    each = [figures(view, clean, frames) for view in found.views]
    row: dict[str, Any] = {**dataclasses.asdict(found.case), "deadline_ms": found.views[0].deadline_ms,
                           "frames": len(frames),
                           "pause_ms": found.pause_ms()}
    row |= {key: mean([one[key] for one in each]) for key in each[0]}
    row["usable_worst"] = min(one["usable"] for one in each)
    row["longest_ms"] = max(one["longest_ms"] for one in each)
    if found.case.join:
        row["join_s"] = usable_at(found.views[0], clean, found.joined)
    return {key: rounded(value) for key, value in {**row, **found.wire}.items()}


def rounded(value: Any) -> Any:
    """JSON has no number for a mean of nothing."""
    if not isinstance(value, float):
        return value
    return None if math.isnan(value) else round(value, 2)
