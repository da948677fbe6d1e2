# SPDX-License-Identifier: GPL-2.0-or-later
"""Two roots on the disk: when one cannot be booted, or does not prove itself, the other one is."""
from collections.abc import Callable

import pytest

from disk import Disk
from qemu import Boot

SLOT = {"A": 34816 * 512, "B": 165888 * 512}  # see board/common/disk.cfg
SLOT_BYTES = 64 << 20


def fill_slot_b(disk: Disk) -> None:
    """What an update will do: the root of slot A, once more."""
    disk.write(SLOT["B"], disk.read(SLOT["A"], SLOT_BYTES))


def spoil(disk: Disk, slot: str) -> None:
    disk.write(SLOT[slot], b"\xff" * 65536)


def spoilt_a(disk: Disk) -> None:
    fill_slot_b(disk)
    spoil(disk, "A")


def spoilt_b(disk: Disk) -> None:
    spoil(disk, "B")


@pytest.mark.parametrize("prepare, environment, slot", [
    (spoilt_a, (), "B"),                      # unreadable: the boot menu goes on to the other one
    # it had its chances
    pytest.param(fill_slot_b, ("slot=A", "left=0"), "B", marks=pytest.mark.long),
    # an update that was cut off
    pytest.param(spoilt_b, ("slot=B", "left=2"), "A", marks=pytest.mark.long),
], ids=["spoilt", "no-boots-left", "bad-update"])
def test_the_other_slot_is_booted(boot: Boot, prepare: Callable[[Disk], None], environment: tuple[str, ...],
                                  slot: str) -> None:
    with boot("slots", environment=environment, prepare=prepare) as guest:
        guest.shell()
        words = guest.sh("cat /proc/cmdline").split()
        assert f"ddx.slot={slot}" in words
        assert f"root=PARTUUID=dd5601de-0{'AB'.index(slot) + 2}" in words
        assert "squashfs (ro" in guest.sh("mount | grep ' on / '")
        # where GRUB would have waited ten seconds for somebody
        assert guest.log.read_bytes().count(b"Press any key") == 0
