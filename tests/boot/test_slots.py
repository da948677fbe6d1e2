# SPDX-License-Identifier: GPL-2.0-or-later
"""Two roots on the disk: if one cannot be booted or does not come up, the other is booted. Damaged file systems are
repaired."""
import pathlib
from collections.abc import Callable, Iterator

import pytest

from parts.common import copy, run
from parts.disk import mbr
from parts.disk.disk import Disk
from parts.guest.qemu import Boot, Guest

pytestmark = pytest.mark.retry

SLOT = {"A": 34816 * 512, "B": 165888 * 512}  # see board/common/disk.cfg
SLOT_BYTES = 64 << 20


def fill_slot_b(disk: Disk) -> None:
    """Copy slot A's root to slot B, as an update does."""
    disk.write(SLOT["B"], disk.read(SLOT["A"], SLOT_BYTES))


def spoil(disk: Disk, slot: str) -> None:
    disk.write(SLOT[slot], b"\xff" * 65536)


def spoilt_b(disk: Disk) -> None:
    spoil(disk, "B")


def booted(guest: Guest, slot: str) -> None:
    words = guest.sh("cat /proc/cmdline").split()
    assert f"ddx.slot={slot}" in words
    assert f"root=PARTUUID=dd5601de-0{'AB'.index(slot) + 2}" in words
    assert "squashfs (ro" in guest.sh("mount | grep ' on / '")
    # GRUB would wait ten seconds for a key
    assert guest.log.read_bytes().count(b"Press any key") == 0


@pytest.fixture(scope="module")
def damaged(boot: Boot, image: pathlib.Path) -> Iterator[Guest]:
    """A card with damaged slot A and without the superblocks of settings and recordings. Slot B has used up its
    attempts as an update, so slot A is the chosen one."""
    def damage(disk: Disk) -> None:
        fill_slot_b(disk)
        spoil(disk, "A")
        for number in (5, 6):
            disk.write(mbr.partition(image, number).begin + 1024, bytes(1024))

    with boot("slots", prepare=damage, environment=("slot=B", "left=0"), processors=1) as guest:
        guest.shell()
        yield guest


def test_the_other_slot_is_booted(damaged: Guest) -> None:
    """The boot menu falls back to slot B, and counts the boot for the chosen slot."""
    booted(damaged, "B")
    assert "ddx.counted=begun=1" in damaged.sh("cat /proc/cmdline").split()
    damaged.wait_until("[ -e /run/slot.failed ]")
    assert damaged.environment() == {"begun": "2"}


def test_the_kernel_s_options_are_those_of_its_slot(damaged: Guest, root: pathlib.Path) -> None:
    lines = (root / "boot/cmdline.cfg").read_text().splitlines()
    wanted = " ".join(line for line in lines if not line.startswith("#"))
    words = damaged.sh("cat /proc/cmdline").split()
    options = [word for word in wanted.replace('"', " ").split() if word not in ("set", "options=", "$options")]
    assert "ramoops.mem_name=ddxlog" in options and words[-len(options):] == options


def test_a_boot_that_was_not_counted_is_reported(damaged: Guest) -> None:
    screen = damaged.sh("echo 'not counted' > /run/slot.wrong; ddxctl health; rm /run/slot.wrong")
    assert "! slot       slot A was to be booted, and did not come up" in screen
    assert "! slot       not counted" in screen


def test_file_systems_without_a_superblock_are_repaired(damaged: Guest) -> None:
    damaged.wait_until("mountpoint -q /rec")
    device = damaged.sh("/usr/libexec/ddx/own-partition 6")
    report = f"{device} is there, after a repair that may have cost recordings; see /run/log/check.DDXREC"
    assert damaged.sh("cat /run/log/recordings-disk").splitlines()[-1] == report
    damaged.wait_for_log(f"DDXVIDEO: {report}".encode())
    damaged.wait_until("ddxctl status ddxvideosave | grep -q state=running")
    health = damaged.sh("ddxctl health || true")
    assert health.count("! slot") == 1
    assert "! disk       /data had to be repaired, and there is no copy on /rec; settings are what is left" in health
    assert "warning: /data had to be repaired" in damaged.shell().run("ddxctl disable ddxvideoload")[1]
    damaged.wait_until("grep -q ddxvideoload.conf /rec/.ddx/settings")  # now there is a copy


@pytest.mark.long
@pytest.mark.parametrize("prepare, environment, slot, after", [
    # its attempts are used up
    (fill_slot_b, ("slot=A", "left=0"), "B", {"slot": "B", "failed": "A"}),
    # an interrupted update
    (spoilt_b, ("slot=B", "left=2"), "A", {"failed": "B"}),
], ids=["no-boots-left", "bad-update"])
def test_an_exhausted_slot_is_not_booted(boot: Boot, prepare: Callable[[Disk], None], environment: tuple[str, ...],
                                slot: str, after: dict[str, str]) -> None:
    with boot("chances", environment=environment, prepare=prepare) as guest:
        guest.shell()
        booted(guest, slot)
        guest.wait_until("[ -e /run/slot.failed ]")
        assert guest.environment() == after


@pytest.mark.long
def test_an_accepted_slot_that_rots_is_replaced(boot: Boot, root: pathlib.Path, tmp_path: pathlib.Path) -> None:
    """Only its kernel is readable. After three panics the other slot is booted; the next boot tries the damaged slot
    once more."""
    kernel, rotten = tmp_path / "root", tmp_path / "rotten"
    (kernel / "boot").mkdir(parents=True)
    for file in (root / "boot").iterdir():
        copy(file, kernel / "boot" / file.name)
    run(["mksquashfs", kernel, rotten, "-comp", "gzip", "-no-progress", "-quiet"])

    def rot(disk: Disk) -> None:
        fill_slot_b(disk)
        disk.write(SLOT["A"], rotten.read_bytes())

    with boot("rotten", prepare=rot, extra=("-action", "reboot=reset")) as guest:
        for panics in (3, 1):
            for _ in range(panics):
                guest.wait_for_event("RESET")
            guest.reset()
            guest.shell()
            booted(guest, "B")
            guest.wait_until("[ -e /run/slot.failed ]")
            assert "! slot       slot A was to be booted, and did not come up" in guest.sh("ddxctl health || true")
            assert guest.environment() == {"begun": "2"}
            guest.shell().begin("reboot")
            guest.wait_for_event("RESET")
