# SPDX-License-Identifier: GPL-2.0-or-later
"""After a power cut at any write of a toggle, the settings are the old or the new ones, complete."""
import pathlib

import pytest

from lib.figures import Figure
from lib.settings_cut import TOGGLES, cuts, toggle, wrong
from parts.disk import blocklog, mbr
from parts.disk.disk import Disk
from parts.guest.qemu import Boot


pytestmark = [pytest.mark.retry, pytest.mark.long]

DICE = 3  # disks with random lost writes for each cut


@pytest.mark.parametrize("naive", [False, True], ids=["ddxctl", "naive"])
def test_settings_survive_a_power_cut_at_any_write(boot: Boot, image: pathlib.Path, tmp_path: pathlib.Path,
                                                   naive: bool, record_property: Figure) -> None:
    log = tmp_path / "writes"
    with boot("power-naive" if naive else "power", writes=log, keep=tmp_path) as guest:
        # Marks the log of writes by writing into the empty slot.
        toggle(guest.sh, lambda text: guest.sh(f"printf '{text.decode()}' | dd of=/dev/vda3 bs=512 conv=sync,notrunc "
                                               "oflag=direct 2> /dev/null"), naive)
        guest.poweroff()
    assert Disk(image, tmp_path).path.exists()
    part = mbr.partition(image, 5)
    with image.open("rb") as file:
        file.seek(part.begin)
        logged = blocklog.LoggedDisk(part.begin, file.read(part.end - part.begin))
        found = cuts(log, logged, tmp_path / "data.ext4", DICE)
    record_property("power_cuts", len(found))
    record_property("wrong", len(wrong(found)))
    assert len(found) > 4 * 3 * (DICE + 1)
    assert {done for done, _ in found} >= set(range(len(TOGGLES)))
    assert bool(wrong(found)) is naive, wrong(found)[:5]
