# SPDX-License-Identifier: GPL-2.0-or-later
"""Power is cut between the first frame and the end of the boot's late work: the next boot records, settings are whole,
and the late work is done then."""
import pathlib
import time

import pytest

from parts.guest import session, testdisk
from parts.guest.qemu import Boot

from .conftest import CARD
from .test_grow import room, wait_until_grown

pytestmark = [pytest.mark.retry, pytest.mark.long]

CUTS = 20
STEP = 0.2  # s between two cuts, from the begin of the late work on


@pytest.mark.parametrize("number", range(CUTS))
def test_power_is_cut_during_late_work(boot: Boot, short_clip: pathlib.Path, tmp_path: pathlib.Path,
                                       number: int) -> None:
    disk = testdisk.make(tmp_path / "test.img", short_clip)
    with boot(f"late-cut{number}", size=CARD, keep=tmp_path, test_disk=disk) as guest:
        guest.shell()
        guest.sh("ddxctl disable ddxdecode")
        guest.wait_until("[ -e /run/late.begun ]", pause=0.1)
        time.sleep(number * STEP)
        guest.process.kill()
        guest.process.wait()
    with boot(f"late-after{number}", keep=tmp_path, test_disk=disk) as guest:
        guest.shell()
        session.wait_for_recording(guest)
        guest.wait_until("[ -e /run/late.done ]")
        wait_until_grown(guest)
        assert room(guest) > 0.95 * CARD
        assert guest.sh("cat /data/ddx/ddxdecode.conf") == "enabled=no"
        assert "enabled=no" in guest.sh("cat /rec/.ddx/settings")
        assert guest.shell().run("ls /run/settings.lost /run/settings.uncopied")[0] != 0
        assert "EXT4-fs error" not in guest.sh("dmesg")
