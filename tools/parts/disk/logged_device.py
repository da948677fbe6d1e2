# SPDX-License-Identifier: GPL-2.0-or-later
"""A disk on this machine, all of whose writes and flushes are logged: for power cuts of programs that run natively."""
import mmap
import os
import pathlib
import subprocess

from parts import processes
from parts.common import MORTAL, SBIN, Closing, Failed, run, wait_until
from parts.disk.blocklog import SECTOR

STOP = 20  # s; QEMU's daemon stops within one


def lacking() -> str:
    """Why this machine cannot have such a disk; empty if it can."""
    there = os.access("/dev/fuse", os.W_OK) and os.access("/dev/loop-control", os.W_OK)
    return "" if os.geteuid() == 0 and there else "needs root, FUSE and loop devices"


class LoggedDevice(Closing):
    """Loop devices on a file of a process that logs all writes and flushes: `log`, for parts.disk.blocklog.

    Writes must come through the devices one by one: QEMU 7.2 mixes up the data of simultaneous writes to such a
    file."""

    def __init__(self, image: pathlib.Path) -> None:
        """The contents of the disk are those of this file, which is written. Behind them is a sector for marks."""
        self.size, self.log, self.file = image.stat().st_size, image.with_suffix(".log"), image.with_suffix(".disk")
        with image.open("r+b") as file:
            file.truncate(self.size + SECTOR)
        for path in (self.log, self.file):
            path.touch()
        nodes = ["driver=file,node-name=image,filename=" + str(image),
                 "driver=file,node-name=log,filename=" + str(self.log),
                 "driver=blklogwrites,node-name=disk,file=image,log=log"]
        words = [word for node in nodes for word in ("--blockdev", node)]
        export = f"type=fuse,id=disk,node-name=disk,mountpoint={self.file},writable=on"
        self.process = subprocess.Popen([*MORTAL, "qemu-storage-daemon", *words, "--export", export],
                                        env={**os.environ, **SBIN})
        self.loops: list[str] = []
        wait_until(lambda: self.file.stat().st_size >= self.size + SECTOR or self.process.poll() is not None,
                   "qemu-storage-daemon does not begin")
        if self.process.poll() is not None:
            raise Failed("qemu-storage-daemon has exited")
        self.device = self.part(0, self.size + SECTOR)

    def part(self, begin: int, size: int) -> str:
        """A device for this part of the disk."""
        words = ["losetup", "--find", "--show", "--offset", str(begin), "--sizelimit", str(size),
                 str(self.file)]
        self.loops.append(run(words).strip())
        return self.loops[-1]

    def mark(self, text: bytes) -> None:
        """Write a mark without a flush, which would also save unsaved data."""
        descriptor = os.open(self.device, os.O_WRONLY | os.O_DIRECT)
        with mmap.mmap(-1, SECTOR) as sector:  # O_DIRECT needs aligned memory
            sector[:len(text)] = text
            os.pwrite(descriptor, sector, self.size)
        os.close(descriptor)

    def end(self) -> None:
        """The log is complete then, also if the daemon has to be killed: that of QEMU 7.2 has been seen to run on after
        its signal."""
        while self.loops:
            run(["losetup", "--detach", self.loops.pop()])
        with self.file.open("rb") as file:
            os.fsync(file.fileno())  # or the log's first sector does not count the last marks
        processes.stop(self.process, STOP)
        if self.process.returncode < 0:  # nothing else takes its file system away
            subprocess.run(["umount", "--lazy", str(self.file)], stderr=subprocess.DEVNULL, check=False)
