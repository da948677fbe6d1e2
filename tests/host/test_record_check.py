# SPDX-License-Identifier: GPL-2.0-or-later
"""The counting of bench/record.py finds frames removed anywhere from a good recording."""
from __future__ import annotations

import pytest

from parts.media.record_check import Found, numbers_lost

pytestmark = pytest.mark.strict

CLIP = 50  # frames, played in a loop


@pytest.mark.parametrize("missing", [[], [0], [0, 1, 2], [30, 31, 32], [49, 50], [60, 70, 71], [198, 199]])
def test_missing_frames_are_counted(missing: list[int]) -> None:
    found = Found(published=200)
    numbers_lost(found, [number % CLIP for number in range(200) if number not in missing], CLIP)
    assert (found.recorded, found.lost, found.wrong) == (200 - len(missing), len(missing), 0)
    assert found.longest == (0 if not missing else 2 if missing[0] == 60 else len(missing))


def test_a_picture_without_a_number_is_wrong() -> None:
    found = Found(published=4)
    numbers_lost(found, [0, None, 2, 3], CLIP)
    assert (found.recorded, found.lost, found.wrong) == (4, 0, 1)
