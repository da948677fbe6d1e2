# SPDX-License-Identifier: GPL-2.0-or-later
"""Power cuts at any write of a toggle: the image's scripts on the host's kernel, with a disk whose writes are logged.
tests/boot/test_settings_power.py does it in the emulated machine, with more kinds of lost writes."""
from __future__ import annotations

import mmap
import os
import pathlib
import subprocess
from collections.abc import Iterator

import pytest

import build
from lib.settings_cut import TOGGLES, cuts, toggle, wrong
from parts.common import MORTAL, SBIN, run
from parts.disk import blocklog
from parts.guest.native_machine import NativeMachine
from parts.guest.slow_disk import FILE_SYSTEMS
from parts.image import native

from .programs import wait_until

pytestmark = pytest.mark.retry

SIZE = 24 << 20  # bytes; several groups, so there is a second superblock, as in the appliance
SECTOR = 512     # for marks, after the file system
ENVIRONMENT = {**os.environ, **SBIN}


class SettingsDisk:
    """A loop device on a file of a process that logs all writes and flushes.

    Writes must come through the device one by one: QEMU 7.2 mixes up the data of simultaneous writes to such a file."""

    def __init__(self, folder: pathlib.Path) -> None:
        self.image, self.log, self.file = folder / "data.img", folder / "writes", folder / "disk"
        run(["truncate", "-s", str(SIZE), self.image])
        run(["mke2fs", "-q", "-b", "1024", *FILE_SYSTEMS["ext4-journal"], "-m", "0", "-L", "DDXDATA", self.image])
        run(["truncate", "-s", str(SIZE + SECTOR), self.image])
        self.before = self.image.read_bytes()[:SIZE]
        for path in (self.log, self.file):
            path.touch()
        nodes = ["driver=file,node-name=image,filename=" + str(self.image),
                 "driver=file,node-name=log,filename=" + str(self.log),
                 "driver=blklogwrites,node-name=disk,file=image,log=log"]
        words = [word for node in nodes for word in ("--blockdev", node)]
        export = f"type=fuse,id=disk,node-name=disk,mountpoint={self.file},writable=on"
        self.process = subprocess.Popen([*MORTAL, "qemu-storage-daemon", *words, "--export", export], env=ENVIRONMENT)
        wait_until(lambda: self.file.stat().st_size >= SIZE + SECTOR)
        self.device = run(["losetup", "--find", "--show", self.file]).strip()

    def mark(self, text: bytes) -> None:
        """Write a mark without a flush, which would also save unsaved data of a toggle."""
        descriptor = os.open(self.device, os.O_WRONLY | os.O_DIRECT)
        with mmap.mmap(-1, SECTOR) as sector:  # O_DIRECT needs aligned memory
            sector[:len(text)] = text
            os.pwrite(descriptor, sector, SIZE)
        os.close(descriptor)

    def end(self) -> None:
        if self.device:
            run(["losetup", "--detach", self.device])
            self.device = ""
        self.process.terminate()
        self.process.wait()


@pytest.fixture
def disk(tmp_path: pathlib.Path) -> Iterator[SettingsDisk]:
    if os.geteuid() != 0 or not os.access("/dev/fuse", os.W_OK) or not os.access("/dev/loop-control", os.W_OK):
        pytest.skip("needs root, FUSE and loop devices")
    disk = SettingsDisk(tmp_path)
    yield disk
    disk.end()


@pytest.mark.parametrize("naive", [False, True], ids=["ddxctl", "naive"])
def test_settings_survive_a_power_cut_at_any_write(disk: SettingsDisk, tmp_path: pathlib.Path, naive: bool) -> None:
    keep = tmp_path / "keep"
    (keep / "data").mkdir(parents=True)
    run(["mount", "-o", "noatime", disk.device, keep / "data"])
    try:
        with NativeMachine(build.dev([native.build()]).parent / "root", keep) as robot:
            toggle(robot.sh, disk.mark, naive)
    finally:
        run(["umount", keep / "data"])
    disk.end()
    found = cuts(disk.log, blocklog.LoggedDisk(0, disk.before), tmp_path / "cut.ext4", 1)
    assert len(found) > 4 * 3 * 2
    assert {done for done, _ in found} >= set(range(len(TOGGLES)))
    assert bool(wrong(found)) is naive, wrong(found)[:5]
