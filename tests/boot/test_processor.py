# SPDX-License-Identifier: GPL-2.0-or-later
"""A board's image runs on each kind of processor that its boards have."""
import pathlib

import pytest

from parts.guest import machine, session, testdisk
from parts.guest.qemu import Boot

from .conftest import BOARD


@pytest.mark.long
@pytest.mark.parametrize("cpu", machine.meta(BOARD).get("other_cpu", "").split())
def test_records_on(boot: Boot, work: pathlib.Path, short_clip: pathlib.Path, cpu: str) -> None:
    with boot("processor", test_disk=testdisk.make(work / "processor.img", short_clip),
              extra=("-cpu", cpu)) as guest:
        session.wait_for_recording(guest)
        family = cpu.partition("family=")[2].partition(",")[0]
        assert set(guest.sh("sed -n 's/^cpu family.*: //p' /proc/cpuinfo").split()) == {family}
