# SPDX-License-Identifier: GPL-2.0-or-later
"""The recordings' disk is pulled out while recording, and plugged in again: reported soon; recording resumes."""
import json
import pathlib

import pytest

from lib.figures import Figure, uptime
from parts.common import run
from parts.guest import session, testdisk
from parts.guest.qemu import Boot, Guest
from parts.guest.session import LOAD, SAVE
from parts.guest.slow_disk import FILE_SYSTEMS, OPTIONS

from .test_disk import SOON, source_is_unaffected, wait_for_out

pytestmark = [pytest.mark.strict, pytest.mark.long]

DISK = "usb-storage"


def plug(guest: Guest) -> None:
    guest.monitor("device_add", driver=DISK, bus="usb.0", drive="recordings", id="stick")
    guest.wait_until("mountpoint -q /rec")


def test_a_disk_that_is_pulled_out(boot: Boot, work: pathlib.Path, clip: pathlib.Path,
                                   record_property: Figure) -> None:
    image = work / "recordings.ext4"
    image.unlink(missing_ok=True)
    run(["mke2fs", "-q", *FILE_SYSTEMS["ext4"], *OPTIONS, "-L", "DDXREC", image, "256M"])
    node = {"driver": "raw", "node-name": "recordings", "file": {"driver": "file", "filename": str(image)}}
    test = testdisk.make(work / "unplugged.img", clip, {f"{LOAD}.conf": "loop=\n", f"{SAVE}.conf": "segment=8\n"})
    extra = ("-device", "qemu-xhci,id=usb", "-blockdev", json.dumps(node))
    with boot("disk-unplugged", test_disk=test, extra=extra, provision=f"service={SAVE} off\n") as guest:
        guest.sh("umount /rec")  # the image's partition
        plug(guest)
        guest.sh(f"ddxctl enable {SAVE}")
        wait_for_out(guest, SAVE, 100)

        begin = uptime(guest)
        guest.monitor("device_del", id="stick")
        guest.wait_until(f'grep -q "recording stopped" /run/log/{SAVE}/current', SOON)
        reported = uptime(guest) - begin
        record_property("seconds_until_told", round(reported, 1))
        assert "! disk       /rec is not mounted" in guest.sh("ddxctl health || true")
        source_is_unaffected(guest)
        assert guest.sh("touch /rec/here 2> /dev/null || ls -A /rec") == ""  # the mount point is read-only

        out = session.follow(guest, 0)[SAVE].out
        plug(guest)
        wait_for_out(guest, SAVE, 100)
        guest.sh(f"ddxctl stop {SAVE}")
        save = session.end_counters(guest, SAVE)
        found = [json.loads(line) for line in guest.sh("ddxctl recordings list --json").splitlines()]
        assert guest.shell().run("ddxctl recordings verify")[0] == 0
    record_property("recorder", {"in": save.frames_in, "out": save.out, "lost": save.lost})
    recorded = [one["frames"] for one in found if "frames" in one]
    assert len(recorded) >= 2 and save.out >= out + 100
    assert sum(recorded) == save.out  # frames counted as recorded, before and after the unplug
    assert save.frames_in == save.out + save.lost_total and save.lost["restart"] + save.lost["write"] > 0
