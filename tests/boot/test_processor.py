# SPDX-License-Identifier: GPL-2.0-or-later
"""A board's image runs on each processor type of its boards."""
import dataclasses
import pathlib

import pytest

from parts.guest import machine, session, testdisk
from parts.guest.qemu import Guest

from .conftest import BOARD

pytestmark = pytest.mark.retry


@pytest.mark.long
@pytest.mark.parametrize("cpu", machine.meta(BOARD).get("other_cpu", "").split())
def test_records_on(image: pathlib.Path, accel: str, board: machine.Machine, work: pathlib.Path,
                    short_clip: pathlib.Path, cpu: str) -> None:
    with Guest(image, accel, dataclasses.replace(board, cpu=cpu),
               test_disk=testdisk.make(work / "processor.img", short_clip)) as guest:
        session.wait_for_recording(guest)
        family = cpu.partition("family=")[2].partition(",")[0]
        assert set(guest.sh("sed -n 's/^cpu family.*: //p' /proc/cpuinfo").split()) == {family}
