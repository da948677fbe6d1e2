# SPDX-License-Identifier: GPL-2.0-or-later
"""Does anything grow while services are switched, thousands of times, and while video flows? On this machine's own
kernel. And the verdict itself: what leaks shows, what a machine keeps anyway does not."""
import pathlib
from collections.abc import Callable

import pytest

import endurance

FEW = 40
LOOKS = 2  # the first and the last one of so few are judged, and each waits until the logger has left old requests
FIRST = {"available": 200_000, "descriptors": 300, "processes": 90, "files": 400,
         **{name: 1000 for name in endurance.RECORDING}}


def grown(**by: int) -> list[str]:
    return endurance.growth([FIRST, {name: value + by.get(name, 0) for name, value in FIRST.items()}])


def test_what_stays_is_fine() -> None:
    assert grown() == []
    assert grown(available=-endurance.MEMORY_LIMIT, store=200, processes=-2, descriptors=-5, files=60) == []


@pytest.mark.parametrize("name, by", [
    ("descriptors", 9), ("processes", 3), ("available", -endurance.MEMORY_LIMIT - 1), ("store", 300),
    ("ddxvideosave", 300), ("files", 70)])
def test_what_grows_is_told(name: str, by: int) -> None:
    assert len(grown(**{name: by})) == 1


def test_a_process_of_a_moment_is_no_growth() -> None:
    looks = [dict(FIRST) for _ in range(20)]
    looks[-1]["processes"] += 9
    assert endurance.growth(looks) == []
    for number, one in enumerate(looks):
        one["descriptors"] += number
    assert len(endurance.growth(looks)) == 1


def test_nothing_grows(root: pathlib.Path) -> None:
    """What leaks grows each time. A logger that was just restarted may hold frames of two epochs in one look."""
    if endurance.growth(endurance.natively(root, "toggles", FEW, LOOKS)):
        assert endurance.growth(endurance.natively(root, "toggles", FEW, LOOKS)) == []


# The logger's queue is used for the first time, piece by piece, for eight minutes; that must be the begin, not the end.
@pytest.mark.long
@pytest.mark.parametrize("kind, amount", [("toggles", endurance.ROUND), ("video", 40)])
def test_nothing_grows_over_time(root: pathlib.Path, record_property: Callable[[str, object], None], kind: str,
                                 amount: int) -> None:
    looks = endurance.natively(root, kind, amount)
    record_property("first", looks[0])
    record_property("last", looks[-1])
    assert endurance.growth(looks) == []
