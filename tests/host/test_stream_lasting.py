# SPDX-License-Identifier: GPL-2.0-or-later
"""A long stream over a lossy link: frames stay whole, all of them are counted, no program grows. Each pattern takes ten
minutes; pytest's option `--seconds` shortens it."""
from __future__ import annotations

import pathlib
from collections.abc import Callable

import pytest

from parts.link.link import Counts
from parts.link.loss import Bursts, EveryThird, Iid, Outages
from parts.media import clip as numbered_clip

from . import two_ends
from .lasting import Lasted, grown, lasting

pytestmark = pytest.mark.retry

WIRE = 250  # kbit/s
SECONDS = 20  # of the clip, which is played in a loop
FRAMES = SECONDS * numbered_clip.RATE
LEAST = {"every third": (EveryThird(), 0.95), "iid": (Iid(0.3), 0.95), "bursts": (Bursts(0.3), 0.85),
         "outages": (Outages(0.3), 0.75)}


NOWHERE = Counts([], [], 0, 0)


def outcome(seen: two_ends.Shown, coded: two_ends.Shown) -> Lasted:
    empty = {"in": 0, "out": 0, "lost": {}}
    return Lasted(empty, {}, empty, {}, seen, coded, NOWHERE, 1, NOWHERE)


def test_wrong_pictures_and_growth_are_found() -> None:
    coded: two_ends.Shown = [(8, 15), (9, 9), (10, 10)]
    assert outcome([(8, 15), (9, None), (10, 10)], coded).wrong(FRAMES) == []
    assert outcome([(8, 15), (9, 10), (FRAMES + 3, 3)], coded).wrong(FRAMES) == [(9, 10)]
    flat = [{"decode": 9000 + number % 3} for number in range(100)]
    assert grown([{"decode": 4000}, *flat]) == [] and grown([*flat, {"decode": 12000}]) != []


@pytest.mark.strict
@pytest.mark.long
@pytest.mark.parametrize("name", LEAST)
def test_minutes_of_a_pattern(tmp_path: pathlib.Path, clip: pathlib.Path, name: str, pytestconfig: pytest.Config,
                              record_property: Callable[[str, object], None]) -> None:
    pattern, least = LEAST[name]
    seconds = int(pytestconfig.getoption("seconds"))
    with lasting(tmp_path, clip, pattern, "-wire", WIRE, local=True) as stream:
        stream.wait_for(numbered_clip.RATE)
        memory = list(stream.samples(seconds * numbered_clip.RATE))
        done = stream.finish()
    way = done.counts.down[0]
    whole = done.right(FRAMES) / int(done.sent["out"])
    record_property("whole_percent", round(100 * whole, 2))
    record_property("kbit", round(way.bytes * 8 / done.seconds / 1000, 1))
    record_property("memory_kib", [memory[len(memory) // 4], memory[-1]])
    print(name, done.sent, done.shown, done.shown_packets, memory, sep="\n")
    assert done.disagreements() == [] and done.wrong(FRAMES) == []
    assert way.lost > 0.2 * way.packets and way.bytes / done.seconds <= WIRE * 1000 / 8
    assert done.sent_packets["reports"] > seconds and done.shown_packets["restored"] > seconds
    assert whole >= least
    assert grown(memory) == []
