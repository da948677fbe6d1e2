# SPDX-License-Identifier: GPL-2.0-or-later
"""The power goes at any write of a toggle: afterwards its settings are the old ones or the new ones, never less."""
import pathlib
import random
import subprocess

import pytest

import blocklog
import mbr
from disk import Disk
from qemu import Boot, Guest

from .figures import Figure

pytestmark = pytest.mark.long

NAME = "ddxvideosave"
FILE = f"/data/ddx/{NAME}.conf"
TOGGLES = ("disable", "enable", "disable", "enable")
WRITTEN = {"enable": b"enabled=yes\n", "disable": b"enabled=no\n"}
MARK = b"toggle %d is done"
DICE = 3  # disks of the second kind for each cut


def mark(guest: Guest, number: int) -> None:
    """Into the log of writes, by way of a slot that is empty."""
    guest.sh(f"printf '{MARK.decode() % number}' | dd of=/dev/vda3 bs=512 conv=sync,notrunc oflag=direct 2> /dev/null")


def settings(image: bytes, file: pathlib.Path) -> bytes | None:
    """What the machine would find at its next boot; None: no such file."""
    file.write_bytes(image)
    for how in ("-p", "-fy"):  # as overlay/etc/init.d/S15storage does it, and with the same tools
        checked = subprocess.run(["e2fsck", how, file], capture_output=True, text=True, check=False)
        if checked.returncode < 2:
            break
    assert checked.returncode < 2, f"the boot would not mount it: {checked.stdout}"
    name = FILE.removeprefix("/data")
    shown = subprocess.run(["debugfs", "-R", f"cat {name}", file], capture_output=True, check=True)
    return None if b"File not found" in shown.stderr else shown.stdout


def cuts(image: pathlib.Path, log: pathlib.Path, scratch: pathlib.Path) -> list[tuple[int, bytes | None]]:
    """For each power cut: how many toggles were done by then, and what was found."""
    chance = random.Random(6)
    part = mbr.partition(image, 5)
    with image.open("rb") as file:
        file.seek(part.begin)
        disk = blocklog.Disk(part.begin, file.read(part.end - part.begin))
    found: list[tuple[int, bytes | None]] = []
    done = -1
    for entry in blocklog.entries(log):
        for number in range(len(TOGGLES) + 1):
            if entry.data.startswith(MARK % number + b"\0"):
                done = number
        if not disk.add(entry) or done < 0 or done == len(TOGGLES):
            continue
        for left in [disk.all_written(), *(disk.some_written(chance) for _ in range(DICE))]:
            found.append((done, settings(left, scratch)))
    return found


def wrong(found: list[tuple[int, bytes | None]]) -> list[str]:
    """Neither what the last toggle left nor what the one under way writes."""
    contents = [None, *(WRITTEN[one] for one in TOGGLES)]
    return [f"after {done} toggles: {text!r}" for done, text in found if text not in contents[done:done + 2]]


@pytest.mark.parametrize("naive", [False, True], ids=["ddxctl", "naive"])
def test_settings_survive_a_power_cut_at_any_write(boot: Boot, image: pathlib.Path, tmp_path: pathlib.Path,
                                                   naive: bool, record_property: Figure) -> None:
    log = tmp_path / "writes"
    with boot("power-naive" if naive else "power", writes=log, keep=tmp_path) as guest:
        mark(guest, 0)
        for number, action in enumerate(TOGGLES, 1):
            if naive:  # the check itself: written in place, as an editor may do
                guest.sh(f": > {FILE}; sync; echo '{WRITTEN[action].decode().strip()}' > {FILE}")
            else:
                guest.sh(f"ddxctl {action} {NAME}")
            mark(guest, number)
        guest.poweroff()
    assert Disk(image, tmp_path).path.exists()
    found = cuts(image, log, tmp_path / "data.ext4")
    record_property("power_cuts", len(found))
    record_property("wrong", len(wrong(found)))
    assert len(found) > 4 * 3 * (DICE + 1)
    assert {done for done, _ in found} >= set(range(len(TOGGLES)))
    assert bool(wrong(found)) is naive, wrong(found)[:5]
