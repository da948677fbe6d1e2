# SPDX-License-Identifier: GPL-2.0-or-later
"""The programs' counters: JSON lines of `ddxctl stats`, and those that programs print when they stop."""
import dataclasses
import json
from typing import Any


@dataclasses.dataclass
class Counters:
    instance: str = ""
    frames_in: int = 0
    out: int = 0
    waiting: int = 0
    lost: dict[str, int] = dataclasses.field(default_factory=dict)
    latency: dict[str, int] = dataclasses.field(default_factory=dict)  # p50, p99, max in µs
    first_ns: int = 0
    starts: int = 0
    skipped: int = 0

    @property
    def lost_total(self) -> int:
        return sum(self.lost.values())


def parse(line: str) -> Counters | None:
    """The counters in a line, which may begin with a time stamp; None if there are none."""
    begin = line.find("{")
    if begin < 0:
        return None
    try:
        values: dict[str, Any] = json.loads(line[begin:])
        return Counters(values["instance"], values["in"], values["out"], values.get("waiting", 0), values["lost"],
                        values["latency_us"], values["first_ns"], values.get("starts", 0), values.get("skipped", 0))
    except (ValueError, KeyError):
        return None


def of(instance: str, text: str) -> list[Counters]:
    """The counters of one instance in the output of `ddxctl stats --json`; empty before it runs."""
    return [one for line in text.splitlines() if (one := parse(line)) and one.instance == instance]


def last(text: str) -> Counters:
    """The last counters in a log."""
    for line in reversed(text.splitlines()):
        if counters := parse(line):
            return counters
    return Counters()


def agree(disagreements: list[str], what: str, ours: int, theirs: int) -> None:
    if ours != theirs:
        disagreements.append(f"{what}: counted {ours}, the program says {theirs}")


def adds_up(disagreements: list[str], *programs: Counters) -> None:
    for one in programs:
        agree(disagreements, f"{one.instance}: out + lost + waiting", one.out + one.lost_total + one.waiting,
              one.frames_in)
