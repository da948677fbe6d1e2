# SPDX-License-Identifier: GPL-2.0-or-later
"""Two roots on the disk: when one cannot be booted, or does not prove itself, the other one is."""
import pathlib

import pytest

import qemu

SLOT = {"A": 34816 * 512, "B": 165888 * 512}  # see board/common/disk.cfg
SLOT_BYTES = 64 << 20


def fill_slot_b(disk: pathlib.Path) -> None:
    """What an update will do: the root of slot A, once more."""
    with disk.open("r+b") as file:
        file.seek(SLOT["A"])
        root = file.read(SLOT_BYTES)
        file.seek(SLOT["B"])
        file.write(root)


def spoil(disk: pathlib.Path, slot: str) -> None:
    with disk.open("r+b") as file:
        file.seek(SLOT[slot])
        file.write(b"\xff" * 65536)


def spoilt_a(disk: pathlib.Path) -> None:
    fill_slot_b(disk)
    spoil(disk, "A")


def spoilt_b(disk: pathlib.Path) -> None:
    spoil(disk, "B")


@pytest.mark.parametrize("prepare, environment, slot", [
    (spoilt_a, (), "B"),                      # unreadable: the boot menu goes on to the other one
    (fill_slot_b, ("slot=A", "left=0"), "B"), # it had its chances
    (spoilt_b, ("slot=B", "left=2"), "A"),    # an update that was cut off
], ids=["spoilt", "no-boots-left", "bad-update"])
def test_the_other_slot_is_booted(image: pathlib.Path, accel: str, work: pathlib.Path, prepare: object,
                                  environment: tuple[str, ...], slot: str) -> None:
    assert callable(prepare)
    with qemu.Guest(image, accel, environment=environment, prepare=prepare, log=work / "slots.log") as guest:
        guest.shell()
        words = guest.sh("cat /proc/cmdline").split()
        assert f"ddx.slot={slot}" in words
        assert f"root=PARTUUID=dd5601de-0{'AB'.index(slot) + 2}" in words
        assert "squashfs (ro" in guest.sh("mount | grep ' on / '")
