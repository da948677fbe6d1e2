# SPDX-License-Identifier: GPL-2.0-or-later
"""Nothing grows while services are switched, or while video flows, in an emulated machine, kernel memory included: the
short form of `make test-long T=endurance`."""
import pathlib

import pytest

import endurance
from lib.figures import Figure
from parts.guest import machine

from .conftest import BOARD

pytestmark = [pytest.mark.retry, 
    pytest.mark.long,
    pytest.mark.skipif(BOARD != machine.DEV, reason="tools/endurance.py starts the development image's machine"),
]


@pytest.mark.parametrize("kind, amount", [("toggles", 100), ("video", 3)])
def test_nothing_grows(image: pathlib.Path, accel: str, record_property: Figure, kind: str, amount: int) -> None:
    looks = endurance.in_guest(image, accel, kind, amount)
    record_property("first", looks[0])
    record_property("last", looks[-1])
    assert endurance.growth(looks) == []
