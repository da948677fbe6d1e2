# SPDX-License-Identifier: GPL-2.0-or-later
"""Settings or recordings that cannot be repaired, and a check that takes long, are reported; everything else runs, and
nothing is formatted without a command."""
import pathlib
import time

import pytest

from lib.figures import Figure, uptime
from parts.common import run
from parts.disk import mbr
from parts.disk.disk import Disk
from parts.guest import session, testdisk
from parts.guest.qemu import Boot, Guest
from parts.guest.session import LOAD, SAVE


pytestmark = [pytest.mark.retry, pytest.mark.long]

SETTINGS, RECORDINGS = 5, 6
# As docs/boards.md says.
FORMAT = "mke2fs -q -t ext4 -O ^has_journal -m 0 -i 1048576 -L DDXREC $(/usr/libexec/ddx/own-partition 6)"


def disk_report(guest: Guest) -> str:
    return guest.sh("tail -n 1 /run/log/recordings-disk")


def frames_flow(guest: Guest) -> None:
    """Wait for a hundred more frames, of which the store loses none."""
    begin = session.follow(guest, 0)[LOAD].out
    while (now := session.follow(guest, 0)[LOAD]).out < begin + 100:
        time.sleep(0.3)
    assert now.lost_total == 0 and now.starts == 1


def test_ruined_recordings(boot: Boot, image: pathlib.Path, work: pathlib.Path, clip: pathlib.Path) -> None:
    part = mbr.partition(image, RECORDINGS)
    test = testdisk.make(work / "ruined.img", clip, {f"{LOAD}.conf": "loop=\nreaders=0\n"})
    with boot("ruined", test_disk=test, prepare=lambda disk: disk.erase(part.begin, part.end - part.begin)) as guest:
        guest.wait_until("grep -q 'cannot be used' /run/log/recordings-disk")
        guest.wait_for_log(b"the recordings' disk, cannot be used: nothing is recorded")
        frames_flow(guest)
        assert f"! service    {SAVE} waits for its disk" in (health := guest.sh("ddxctl health || true"))
        assert "! disk       /rec is not mounted; " in health
        assert "state=waiting" in guest.sh(f"ddxctl status {SAVE}")
        assert guest.sh("touch /rec/here 2> /dev/null || ls -A /rec") == ""
        guest.sh(FORMAT)
        guest.wait_until("mountpoint -q /rec")  # mounted by the next attempt
        session.wait_for_recording(guest)
        frames_flow(guest)
        guest.sh(f"ddxctl stop {SAVE}")
        save = session.end_counters(guest, SAVE)
        assert save.out > 100 and save.frames_in == save.out + save.lost_total and save.starts == 1
        assert guest.sh("ddxctl recordings verify")


def test_a_check_that_takes_long(boot: Boot, image: pathlib.Path, work: pathlib.Path, clip: pathlib.Path,
                                 record_property: Figure) -> None:
    """Without a superblock the thorough check reads all of many files."""
    part = mbr.partition(image, RECORDINGS)
    large = work / "many-files.ext4"
    large.unlink(missing_ok=True)
    run(["mke2fs", "-q", "-t", "ext4", "-O", "^has_journal", "-b", "1024", "-N", "500000", "-L", "DDXREC", large,
         f"{(part.end - part.begin) >> 10}k"])
    with large.open("r+b") as file:
        file.seek(1024)
        file.write(bytes(1024))
    test = testdisk.make(work / "long-check.img", clip, {f"{LOAD}.conf": "loop=\nreaders=0\n"})
    with boot("long-check", test_disk=test, prepare=lambda disk: disk.write(part.begin, large.read_bytes())) as guest:
        guest.shell()
        seen = session.follow(guest, 0)
        assert LOAD in seen and SAVE not in seen and disk_report(guest).endswith("is being checked")
        frames_flow(guest)
        record_property("frames_in_the_store_meanwhile", session.follow(guest, 0)[LOAD].out)
        guest.wait_until("mountpoint -q /rec")
        record_property("seconds_until_mounted", uptime(guest))
        session.wait_for_recording(guest)
        frames_flow(guest)


def test_ruined_settings(boot: Boot, image: pathlib.Path, tmp_path: pathlib.Path) -> None:
    """Services that were switched off stay off, and new toggles hold."""
    part = mbr.partition(image, SETTINGS)

    def off(guest: Guest, name: str) -> bool:
        return "enabled=no state=stopped" in guest.shell().run(f"ddxctl status {name}")[1]

    with boot("settings", keep=tmp_path) as guest:
        guest.sh("ddxctl disable ddxvideoV4L")
        guest.wait_until("grep -q ddxvideoV4L.conf /rec/.ddx/settings")
        guest.poweroff()
    Disk(image, tmp_path).erase(part.begin, part.end - part.begin)
    with boot("ruined-settings", keep=tmp_path) as guest:
        assert off(guest, "ddxvideoV4L") and not off(guest, LOAD)
        assert "! disk       /data cannot be used" in guest.sh("ddxctl health || true")
        assert "warning: /data cannot be used" in guest.sh(f"ddxctl disable {LOAD} 2>&1")
        guest.wait_until(f"grep -q {LOAD}.conf /rec/.ddx/settings")
        guest.poweroff()
    with boot("ruined-settings", keep=tmp_path) as guest:
        assert off(guest, "ddxvideoV4L") and off(guest, LOAD) and not off(guest, SAVE)
