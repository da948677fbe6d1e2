# SPDX-License-Identifier: GPL-2.0-or-later
"""The verdict of make endurance: what leaks shows, what a machine keeps anyway does not."""
import pytest

import endurance

FIRST = {"available": 200_000, "descriptors": 300, "processes": 90, **{name: 1000 for name in endurance.PROGRAMS}}


def grown(**by: int) -> list[str]:
    return endurance.growth([FIRST, {name: value + by.get(name, 0) for name, value in FIRST.items()}])


def test_what_stays_is_fine() -> None:
    assert grown() == []
    assert grown(available=-endurance.MEMORY_LIMIT, store=200, processes=-2, descriptors=-5) == []


@pytest.mark.parametrize("name, by", [
    ("descriptors", 1), ("processes", 1), ("available", -endurance.MEMORY_LIMIT - 1), ("store", 300),
    ("ddxvideosave", 300)])
def test_what_grows_is_told(name: str, by: int) -> None:
    assert len(grown(**{name: by})) == 1
