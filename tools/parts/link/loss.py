# SPDX-License-Identifier: GPL-2.0-or-later
"""Patterns of packet loss. A pattern makes a judge for each direction, from that direction's random generator.

A judge is asked once for each packet, in order, with the time in seconds since the pattern began. The answer for packet
n depends only on the seed and n; for outages, only on the seed and the time.
"""
import dataclasses
import random
from collections.abc import Callable
from typing import Any

Judge = Callable[[float], bool]  # time -> whether the packet is lost


@dataclasses.dataclass(frozen=True)
class Pattern:
    """The base class, which loses nothing."""

    def judge(self, generator: random.Random) -> Judge:
        return lambda _: False

    @property
    def shared(self) -> bool:
        """Whether both directions lose at the same times."""
        return False


@dataclasses.dataclass(frozen=True)
class EveryThird(Pattern):
    """The seed decides which of the first three packets is lost first."""

    def judge(self, generator: random.Random) -> Judge:
        number = generator.randrange(3)

        def lost(_: float) -> bool:
            nonlocal number
            number += 1
            return number % 3 == 0

        return lost


@dataclasses.dataclass(frozen=True)
class Iid(Pattern):
    """Loses each packet with this probability, independently; 1 blocks the direction."""
    rate: float

    def judge(self, generator: random.Random) -> Judge:
        return lambda _: generator.random() < self.rate


@dataclasses.dataclass(frozen=True)
class Bursts(Pattern):
    """Gilbert's model: loses this share of all packets, in bursts of this mean length."""
    rate: float
    length: float = 5

    def judge(self, generator: random.Random) -> Judge:
        leave = 1 / self.length
        enter = leave * self.rate / (1 - self.rate)
        bad = generator.random() < self.rate

        def lost(_: float) -> bool:
            nonlocal bad
            now = bad
            bad = generator.random() >= leave if bad else generator.random() < enter
            return now

        return lost


@dataclasses.dataclass(frozen=True)
class Outages(Pattern):
    """Loses all packets of a direction for this share of the time; outages and pauses have exponential lengths. With
    `together` they are at the same times in both directions, which is easier for a stream: a report that comes shows
    that packets arrive."""
    part: float
    mean_ms: float = 40
    together: bool = False

    def judge(self, generator: random.Random) -> Judge:
        outage = self.mean_ms / 1000
        pause = outage * (1 - self.part) / self.part
        bad = generator.random() < self.part
        end = generator.expovariate(1 / (outage if bad else pause))

        def lost(now: float) -> bool:
            nonlocal bad, end
            while now >= end:
                bad = not bad
                end += generator.expovariate(1 / (outage if bad else pause))
            return bad

        return lost

    @property
    def shared(self) -> bool:
        return self.together


NOTHING, ALL = Pattern(), Iid(1)
KINDS: dict[str, type[Pattern]] = {kind.__name__: kind for kind in (Pattern, EveryThird, Iid, Bursts, Outages)}


def pack(pattern: Pattern) -> list[Any]:
    """A pattern in a form for JSON."""
    return [type(pattern).__name__, dataclasses.asdict(pattern)]


def unpack(packed: list[Any]) -> Pattern:
    return KINDS[packed[0]](**packed[1])


def judge(pattern: Pattern, seed: int, operator: int, direction: str) -> Judge:
    """A judge with the generator of this operator and direction."""
    words = ["both" if pattern.shared else direction, str(operator), str(seed)]
    return pattern.judge(random.Random(" ".join(words)))
