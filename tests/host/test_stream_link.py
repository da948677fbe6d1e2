# SPDX-License-Identifier: GPL-2.0-or-later
"""The stream over a link that loses 30 % of the packets, within its rate: the share of frames that the operator sees
whole, by the numbers in the pictures. Frames that a busy machine could not send are counted, but not judged."""
from __future__ import annotations

import pathlib
from concurrent.futures import ThreadPoolExecutor

import pytest

from parts.link.loss import ALL, Iid
from parts.media import clip as numbered_clip

from . import two_ends
from .stream import PORT
from .two_ends import Run

pytestmark = pytest.mark.retry

WIRE = 250  # kbit/s
LOSS = Iid(0.3)
SECONDS, SHORT = 8, 3


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    return numbered_clip.write(tmp_path_factory.mktemp("short") / "clip.y4m", SHORT)


def say(run: Run) -> None:
    way = run.counts.down[0]
    print(f"{100 * run.whole:.1f} % of {run.sent['out']} frames, {way.bytes * 8 / run.seconds / 1000:.0f} kbit/s, most "
          f"{way.peak * 8 / 1000:.0f}, late by {run.counts.late_ms:.0f} ms\n{run}")


def test_wrong_numbers_are_found() -> None:
    """At any rate: coarse pictures may still show 107 for 108 and 109, or all bits of 7 for 8. If each number were one
    too high, the robot's pictures would not excuse it."""
    coded: two_ends.Shown = [(5, None), (6, 6), (7, 7), (8, 15), (9, 9), (107, 107), (108, 107), (109, 107), (110, 110)]
    assert two_ends.wrong_numbers(coded, coded) == []
    assert two_ends.wrong_numbers([(108, 107), (109, 108), (110, None)], coded) == [(109, 108)]
    late: two_ends.Shown = [(number + 1, number) for number in range(200)]
    assert two_ends.wrong_numbers(late, late) == late


@pytest.mark.strict
def test_with_reports(tmp_path: pathlib.Path, clip: pathlib.Path) -> None:
    run = two_ends.run(tmp_path, clip, LOSS, LOSS, "-wire", WIRE)
    say(run)
    assert run.disagreements(SECONDS * numbered_clip.RATE) == []
    assert run.whole >= 0.95
    assert run.beyond_rate(WIRE) == []
    assert run.counts.down[0].lost > 0.2 * run.counts.down[0].packets
    assert run.shown_packets["restored"] > 0 and run.shown_packets["reports"] > run.sent_packets["reports"] > 0


def test_without_reports_and_without_repair(tmp_path: pathlib.Path, short: pathlib.Path) -> None:
    """In parallel: with blocked reports, repair packets are sent in advance; without any repair, the figure must be
    bad."""
    cases = {"one-way": (ALL, "-repair", 1.75), "off": (LOSS, "-repair", "off")}
    with ThreadPoolExecutor() as pool:
        started = {name: pool.submit(two_ends.run, tmp_path / name, short, LOSS, back, "-wire", WIRE, *options)
                   for name, (back, *options) in cases.items()}
        runs = {name: one.result() for name, one in started.items()}
    for run in runs.values():
        say(run)
        assert run.disagreements(SHORT * numbered_clip.RATE) == []
        assert run.beyond_rate(WIRE) == []
    one_way, off = runs["one-way"], runs["off"]
    assert one_way.whole >= 0.9 and one_way.sent_packets["reports"] == 0
    assert off.whole < 0.5 and off.sent_packets["repairs"] == 0
    assert set(off.counts.down[0].ports) == {PORT}
