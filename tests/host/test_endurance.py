# SPDX-License-Identifier: GPL-2.0-or-later
"""Nothing grows while services are switched thousands of times, or while video flows, on the host's kernel. Also tests
the verdict: a leak is reported, normal variation is not."""
import pathlib
from collections.abc import Callable

import pytest

import endurance

pytestmark = pytest.mark.retry

FEW = 40
LOOKS = 2  # samples; the first and the last are judged, each once the logger has released old requests
FIRST = {"available": 200_000, "descriptors": 300, "processes": 90, "files": 400,
         **{name: 1000 for name in endurance.RECORDING}}


def grown(**by: int) -> list[str]:
    return endurance.growth([FIRST, {name: value + by.get(name, 0) for name, value in FIRST.items()}])


def test_steady_values_are_not_growth() -> None:
    assert grown() == []
    assert grown(available=-endurance.MEMORY_LIMIT, ddxstore=200, processes=-2, descriptors=-5, files=60) == []


@pytest.mark.parametrize("name, by", [
    ("descriptors", 9), ("processes", 3), ("available", -endurance.MEMORY_LIMIT - 1), ("ddxstore", 300),
    ("ddxvideosave", 300), ("files", 70)])
def test_growth_is_reported(name: str, by: int) -> None:
    assert len(grown(**{name: by})) == 1


def test_a_short_lived_process_is_not_growth() -> None:
    looks = [dict(FIRST) for _ in range(20)]
    looks[-1]["processes"] += 9
    assert endurance.growth(looks) == []
    for number, one in enumerate(looks):
        one["descriptors"] += number
    assert len(endurance.growth(looks)) == 1


def test_nothing_grows(root: pathlib.Path) -> None:
    """Growth counts only if it repeats: a restarted logger may briefly hold frames of two epochs."""
    if endurance.growth(endurance.natively(root, "toggles", FEW, LOOKS)):
        assert endurance.growth(endurance.natively(root, "toggles", FEW, LOOKS)) == []


# The logger touches the memory of its queue for the first time during eight minutes, which must be the beginning.
@pytest.mark.long
@pytest.mark.parametrize("kind, amount", [("toggles", endurance.ROUND), ("video", 40)])
def test_nothing_grows_over_hours(root: pathlib.Path, record_property: Callable[[str, object], None], kind: str,
                                 amount: int) -> None:
    looks = endurance.natively(root, kind, amount)
    record_property("first", looks[0])
    record_property("last", looks[-1])
    assert endurance.growth(looks) == []
