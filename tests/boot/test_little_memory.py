# SPDX-License-Identifier: GPL-2.0-or-later
"""An old board with 128 MiB of memory records without a loss."""
import pathlib

import pytest

from lib import budget
from lib.figures import Figure
from parts.guest import session, testdisk
from parts.guest.machine import Machine
from parts.guest.qemu import Boot
from parts.media import clip as default_clip


pytestmark = [pytest.mark.retry, pytest.mark.long]

MEMORY = 128  # MiB


def test_a_machine_with_little_memory_records_the_clip(boot: Boot, board: Machine, work: pathlib.Path,
                                                       short_clip: pathlib.Path, record_property: Figure) -> None:
    disk = testdisk.make(work / "little.img", short_clip)
    with boot("little", test_disk=disk, more_memory=MEMORY - board.memory) as guest:
        guest.shell()
        session.wait_for_clip(guest, default_clip.SHORT * default_clip.RATE)
        guest.wait_until("[ -e /run/late.done ]")
        record_property("MiB_in_use", round(budget.memory(guest), 1))
        record_property("MiB_available", round(budget.meminfo(guest)["MemAvailable"] / 1024, 1))
        session.stop_recorder(guest)
        result = session.collect(guest, short_clip, work / "little-recorded.y4m")
        assert "Out of memory" not in guest.sh("dmesg")
    assert result.disagreements == []
    assert result.good and result.lost_store == 0 and result.lost_record == 0
