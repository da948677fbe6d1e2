# SPDX-License-Identifier: GPL-2.0-or-later
"""What the programs say about their frames: JSON lines of `ddxctl stats` and of the programs at their end."""
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
    """One line, which may have a time stamp before the JSON; None if it holds no counters."""
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
    """Those of one instance, among the lines of `ddxctl stats --json`; none as long as it is not in the store."""
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
