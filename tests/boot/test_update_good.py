# SPDX-License-Identifier: GPL-2.0-or-later
"""A good version is kept: on a machine whose settings are lost or have no room, whose cable is pulled, and whose
recordings are checked for longer than a trial may take."""
import pathlib

import pytest

from parts.common import PATIENCE
from parts.disk import mbr
from parts.disk.disk import Disk
from parts.guest import testdisk
from parts.guest.laptop import forward, free_port
from parts.guest.qemu import Boot, Guest

from . import slot_image
from .slot_image import DOG, RECORDS, SETTINGS, script
from .test_slots import SLOT

pytestmark = [pytest.mark.retry, pytest.mark.long]

KEPT = "ddxctl update status --json | grep -q '\"last\":\"{}\"'"


def records(guest: Guest) -> None:
    guest.shell()
    guest.wait_until(RECORDS)
    guest.wait_until("! pidof slot-came-up > /dev/null")


def start(guest: Guest) -> None:
    """Start the new version, until QEMU has reset the machine."""
    guest.shell().begin("ddxctl update start")
    guest.wait_for_event("RESET")
    guest.reset()


def is_kept(guest: Guest, last: str = "kept", patience: float = PATIENCE) -> None:
    assert "ddx.slot=B" in guest.sh("cat /proc/cmdline").split()
    guest.wait_until(KEPT.format(last), patience)
    assert guest.environment() == {"slot": "B"}
    guest.wait_until(RECORDS)


@pytest.mark.parametrize("how", ["full", "lost"])
def test_a_version_is_kept_without_a_note(boot: Boot, image: pathlib.Path, root: pathlib.Path, tmp_path: pathlib.Path,
                                          clip: pathlib.Path, how: str) -> None:
    """/data is full, or cannot be mounted and is forgotten at the restart: what is enabled has to run."""
    new = slot_image.make(root, tmp_path / "new.squashfs")
    disk = testdisk.make(tmp_path / "clip.img", clip, SETTINGS)

    def fill(disk: Disk) -> None:
        disk.write(SLOT["B"], new.read_bytes())
        if how == "lost":
            part = mbr.partition(image, 5)
            disk.erase(part.begin, part.end - part.begin)

    with boot("no-data", test_disk=disk, prepare=fill, extra=DOG, more_memory=64) as guest:
        records(guest)
        if how == "full":
            guest.sh("dd if=/dev/zero of=/data/full bs=1024 2> /dev/null || true")
        start(guest)
        guest.shell()
        is_kept(guest, "\\(none\\|kept\\)")
        assert guest.sh("[ -e /data/update ] && cat /data/update || true").count("result=begun") == 0


def test_a_version_is_kept_without_a_carrier(boot: Boot, root: pathlib.Path, tmp_path: pathlib.Path,
                                             clip: pathlib.Path) -> None:
    """The cable is pulled at the restart. The version before had an address."""
    new = slot_image.make(root, tmp_path / "new.squashfs")
    disk = testdisk.make(tmp_path / "clip.img", clip, SETTINGS)

    with boot("no-carrier", provision="network=eth0 dhcp\n", test_disk=disk, more_memory=64,
              prepare=lambda disk: disk.write(SLOT["B"], new.read_bytes()),
              extra=(*forward(free_port()), *DOG)) as guest:
        records(guest)
        guest.wait_until("grep -q eth0 /proc/net/route")
        start(guest)
        guest.monitor("set_link", name="laptop", up=False)
        guest.shell()
        is_kept(guest)
        assert guest.sh("cat /sys/class/net/eth0/carrier") == "0"
        assert guest.run("grep eth0 /proc/net/route")[0] == 1
        assert "addresses=eth0" in guest.sh("cat /data/update").splitlines()


def check_slowly(root: pathlib.Path) -> None:
    """The recordings get a thorough check, which lasts longer than the deadline from the trial's begin on."""
    program = root / "sbin/e2fsck"
    program.rename(program.with_name("real-e2fsck"))
    program.touch()
    script(program, 'case "$*" in\n"-p "*6) exit 4 ;;\n'
                    '"-fy "*6) until [ -e /run/update.trial ]; do sleep 1; done; sleep 150 ;;\nesac\n'
                    'exec /sbin/real-e2fsck "$@"')


def test_a_long_check_of_the_recordings_does_not_count(boot: Boot, root: pathlib.Path, tmp_path: pathlib.Path,
                                                       clip: pathlib.Path) -> None:
    new = slot_image.make(root, tmp_path / "new.squashfs", check_slowly)
    disk = testdisk.make(tmp_path / "clip.img", clip, SETTINGS)

    with boot("long-check", test_disk=disk, prepare=lambda disk: disk.write(SLOT["B"], new.read_bytes()), extra=DOG,
              more_memory=64) as guest:
        records(guest)
        start(guest)
        guest.shell()
        guest.wait_until("grep -q 'ddxvideosave.*; taken back in' /run/update.trial")
        is_kept(guest, patience=2 * PATIENCE)
        assert "Pass 5" in guest.sh("cat /run/log/check.DDXREC")
