# SPDX-License-Identifier: GPL-2.0-or-later
"""Power cuts during recording and disk checks: the machine records again by itself (see tools/killed.py)."""
import pathlib

import pytest

import killed
from killed import Kill, Plug
from lib.figures import Figure
from parts.common import Failed
from parts.guest.machine import Machine

pytestmark = [pytest.mark.long, pytest.mark.retry]


def test_records_again_after_power_cuts(image: pathlib.Path, accel: str, board: Machine, clip: pathlib.Path,
                                        tmp_path: pathlib.Path, record_property: Figure) -> None:
    plug = Plug(image, accel, board, tmp_path, clip)
    done: list[Kill] = []
    kills = [Kill("recording", 2.0), Kill("check", 0.3)]
    last = killed.run(plug, kills, done, lambda _: None)
    with plug.boot() as guest:
        plug.judge(guest, last)
        pictures, wrong = plug.end(guest)
        guest.sh("ddxctl disable ddxvideosave")  # proves that the check can fail
        guest.process.kill()
    record_property("seconds_until_recording_again", [one.again for one in kills])
    record_property("pictures", {"recorded": pictures, "wrong": wrong})
    assert all(one.again > 0 and one.files >= 1 for one in kills)
    assert pictures > 25 and wrong == 0
    plug.patience = 25.0
    with plug.boot() as guest, pytest.raises(Failed, match="does not record again"):
        plug.judge(guest, [])
