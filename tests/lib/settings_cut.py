# SPDX-License-Identifier: GPL-2.0-or-later
"""Toggles of one service, and its settings after a power cut at any of their writes."""
import pathlib
import random
import subprocess
from collections.abc import Callable

from parts.common import SBIN
from parts.disk import blocklog

NAME = "ddxvideosave"
FILE = f"/data/ddx/{NAME}.conf"
TOGGLES = ("disable", "enable", "disable", "enable")
WRITTEN = {"enable": b"enabled=yes\n", "disable": b"enabled=no\n"}
MARK = b"toggle %d is done"
Found = list[tuple[int, bytes | None]]  # number of finished toggles, and the settings


def toggle(sh: Callable[[str], object], mark: Callable[[bytes], object], naive: bool) -> None:
    """Run the toggles; `sh` runs a command there, `mark` writes to its disk outside of the file system."""
    mark(MARK % 0)
    for number, action in enumerate(TOGGLES, 1):
        if naive:  # to check this test: written in place, as some editors do
            sh(f": > {FILE}; sync; echo '{WRITTEN[action].decode().strip()}' > {FILE}")
        else:
            sh(f"ddxctl {action} {NAME}")
        mark(MARK % number)


def settings(file: pathlib.Path) -> bytes | None:
    """The settings that a machine with this disk finds at its next boot; None if there is no file."""
    for how in ("-p", "-fy"):  # like overlay/etc/init.d/S15storage
        checked = subprocess.run(["e2fsck", how, file], capture_output=True, text=True, check=False, env=SBIN)
        if checked.returncode < 2:
            break
    assert checked.returncode < 2, f"the boot would not mount it: {checked.stdout}"
    name = FILE.removeprefix("/data")
    shown = subprocess.run(["debugfs", "-R", f"cat {name}", file], capture_output=True, check=True, env=SBIN)
    return None if b"File not found" in shown.stderr else shown.stdout


def cuts(log: pathlib.Path, disk: blocklog.LoggedDisk, scratch: pathlib.Path, dice: int) -> Found:
    """For each power cut: the finished toggles and the settings, on the disk with all writes and on `dice` disks that
    lack some of the writes since the last flush."""
    chance = random.Random(6)
    found: Found = []
    done = -1
    for entry in blocklog.entries(log):
        for number in range(len(TOGGLES) + 1):
            if entry.data.startswith(MARK % number + b"\0"):
                done = number
        if not disk.add(entry) or done < 0 or done == len(TOGGLES):
            continue
        for written in [disk.all_written(), *(disk.some_written(chance) for _ in range(dice))]:
            disk.make(scratch, written)
            found.append((done, settings(scratch)))
    return found


def wrong(found: Found) -> list[str]:
    """Settings that are neither those of the last finished toggle nor those of the present one."""
    contents = [None, *(WRITTEN[one] for one in TOGGLES)]
    return [f"after {done} toggles: {text!r}" for done, text in found if text not in contents[done:done + 2]]
