# SPDX-License-Identifier: GPL-2.0-or-later
"""On a disk larger than the image, the recordings' partition grows to the whole disk while recording."""
import pathlib
import shutil
import time

import pytest

from parts.common import run
from parts.disk import mbr
from parts.guest import session
from parts.guest.qemu import Boot, Guest
from parts.media.recording import FileSystem

from .conftest import CARD

pytestmark = pytest.mark.retry

# Seconds after the growing began: while table and file system grow; while the changes are written to disk.
CUTS = [0.3, 5.0]


def room(guest: Guest) -> int:
    """The size of the recordings' file system in bytes."""
    return int(guest.sh("stat -f -c '%b %S' /rec").split()[0]) * 4096


def wait_until_grown(guest: Guest) -> None:
    guest.wait_until("grep -q '^ddxgrow: done' /run/log/ddxgrow")


def test_recordings_get_the_whole_disk(recorder: Guest) -> None:
    wait_until_grown(recorder)
    assert room(recorder) > 0.95 * CARD
    session.wait_for_recording(recorder)
    said = recorder.sh("/usr/libexec/ddx/grow 2>&1")  # as on the next boot
    assert "ddxgrow: /dev/vda: nothing to do" in said and "Nothing to do!" in said  # the latter from resize2fs
    recorder.sh("/etc/init.d/S*ddxvideosave stop; mount -o remount,ro /rec")
    snapshot = recorder.snapshot()
    assert mbr.partition(snapshot, 6).end == CARD
    assert [name for name in FileSystem(snapshot).names() if name.endswith(".y4m")]
    # Other tests of this guest begin with one recording.
    recorder.sh("mount -o remount,rw /rec; rm /rec/*.y4m; /etc/init.d/S*ddxvideosave start")


@pytest.fixture(scope="module")
def used(boot: Boot, tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    """A disk with a recording, to be copied to a larger card."""
    folder = tmp_path_factory.mktemp("used")
    with boot("used", keep=folder) as guest:
        guest.shell()
        guest.sh("echo kept > /rec/kept")
        guest.poweroff()
    run(["qemu-img", "resize", "-q", folder / "disk.qcow2", str(CARD)])
    return folder


@pytest.mark.long
@pytest.mark.parametrize("seconds", CUTS)
def test_power_is_cut_while_it_grows(boot: Boot, used: pathlib.Path, tmp_path: pathlib.Path, seconds: float) -> None:
    """The next boot completes the growing, and keeps the recording."""
    shutil.copy(used / "disk.qcow2", tmp_path)
    with boot("cut", keep=tmp_path) as guest:
        guest.wait_until("[ -e /run/log/ddxgrow ]", pause=0.1)
        time.sleep(seconds)
        guest.process.kill()
        guest.process.wait()
    with boot("after", keep=tmp_path) as guest:
        guest.shell()
        wait_until_grown(guest)
        assert room(guest) > 0.95 * CARD
        assert guest.sh("cat /rec/kept") == "kept"
        assert "EXT4-fs error" not in guest.sh("dmesg")
