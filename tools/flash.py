#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""Write an image to a disk and verify it: flash.py BOARD=... DEV=/dev/sdX [WORD=VALUE ...], see docs/flash.md.

Exit status 2: refused, nothing was written. 1: failed or interrupted; the disk then has no boot sector.
"""
import contextlib
import dataclasses
import pathlib
import secrets
import signal
import sys
import time
from types import FrameType

from parts.common import OUTPUT, Failed, say
from parts.flash import blockmap, provision, target
from parts.flash.blockio import CHUNK, Device, Source
from parts.flash.blockmap import Range

WORDS = ["BOARD", "DEV", "IMAGE", "YES", "FILE", "SSH_KEY", "HOSTNAME", "NETWORK", "CONSOLE", "SERIAL"]
SIGNATURE = 440  # offset of the disk's signature in its boot sector; four bytes
START = 2**20  # boot sector, partition table and boot loader: written last, so that only a complete disk boots


@dataclasses.dataclass
class Job:
    image: pathlib.Path
    source: Source
    device: Device
    size: int  # of the disk

    def close(self) -> None:
        self.source.close()
        self.device.close()


class Progress:
    """A line that is updated on a terminal; else a line for each 10 %."""

    def __init__(self, verb: str, total: int) -> None:
        self.verb, self.total, self.done, self.shown = verb, total, 0, 0.0
        self.begin = time.monotonic()
        self.live = sys.stdout.isatty()

    def add(self, count: int) -> None:
        self.done += count
        now = time.monotonic()
        part = self.done / self.total
        if self.live and (now - self.shown >= 0.2 or part == 1):
            self.shown = now
            rate = self.done / max(now - self.begin, 0.001)
            left = (self.total - self.done) / rate
            sys.stdout.write(f"\r{self.verb} {part:4.0%}  {rate / 1e6:6.1f} MB/s  {left:4.0f} s left ")
            sys.stdout.write("\n" if part == 1 else "")
            sys.stdout.flush()
        elif not self.live and int(part * 10) > self.shown:
            self.shown = int(part * 10)
            say(f"{self.verb} {part:.0%}")


def parse(arguments: list[str]) -> dict[str, str]:
    words = dict.fromkeys(WORDS, "")
    for argument in arguments:
        name, sign, value = argument.partition("=")
        if name not in words or not sign:
            raise Failed(f"unknown word {argument}; expected one of {'=, '.join(WORDS)}=")
        words[name] = value
    for name in ["YES", "FILE"]:
        if words[name] not in ("", "0", "1"):
            raise Failed(f"{name}={words[name]}: say {name}=1 or leave it out")
    if not words["DEV"]:
        raise Failed("which disk? DEV=/dev/sdX (lsblk lists the disks)")
    if not words["BOARD"] and not words["IMAGE"]:
        raise Failed("which image? BOARD=name or IMAGE=file")
    if "/" in words["BOARD"] or words["BOARD"].startswith("."):
        raise Failed(f"BOARD={words['BOARD']} is not the name of a board")
    return words


def _find_image(words: dict[str, str]) -> pathlib.Path:
    image = pathlib.Path(words["IMAGE"] or OUTPUT / words["BOARD"] / "disk.img")
    if not image.is_file():
        raise Failed(f"there is no {image}; build it first, or name one with IMAGE=")
    size = image.stat().st_size
    if size % 512 or size <= START:
        raise Failed(f"{image} is not a disk image: it has {size:,} bytes")
    return image


def _check_file(path: pathlib.Path, image: pathlib.Path) -> None:
    """Fail unless this file can be overwritten (FILE=1)."""
    need = image.stat().st_size
    if path.is_block_device():
        raise Failed(f"FILE=1 is for files; {path} is a device")
    if not path.exists():
        return
    if not path.is_file():
        raise Failed(f"{path} is not a file")
    if path.samefile(image):
        raise Failed(f"{path} is the image itself")
    for loop in target.loops_on(path):
        raise Failed(f"{path} is in use by /dev/{loop}; losetup -d it first")
    if path.stat().st_size < need or path.stat().st_size % 512:
        raise Failed(f"{path} is too small or odd: it has {path.stat().st_size:,} bytes, the image needs {need:,}")
    say(f"{path}: a file, {target.amount(path.stat().st_size)}; it will be overwritten")


def _confirm(path: pathlib.Path, words: dict[str, str]) -> None:
    if words["YES"] == "1":
        return
    if not sys.stdin.isatty():
        raise Failed("there is no terminal to ask at; YES=1 says that it is the right disk")
    sys.stdout.write(f"Everything on {path} will be lost. Type {path.name} to go on: ")
    sys.stdout.flush()
    if sys.stdin.readline().strip() not in (path.name, str(path)):
        raise Failed("that is not the name of the disk; nothing was written")


def prepare(words: dict[str, str]) -> Job:
    """Check everything that can be checked without writing; fails with the reason to refuse."""
    image = _find_image(words)
    need = image.stat().st_size
    lines = provision.lines(words["SSH_KEY"], words["HOSTNAME"], words["CONSOLE"], words["NETWORK"])
    path = pathlib.Path(words["DEV"])
    if words["FILE"] == "1":
        _check_file(path, image)
    else:
        disk = target.TargetDisk(path)
        path = disk.path
        say(disk.title())
        for line in disk.contents():
            say(f"  {line}")
        disk.refuse(need)
    source = Source(image)
    # With two flashed disks in one machine, the loader passes the kernel this number to name the boot disk.
    source.replace(SIGNATURE, secrets.token_bytes(4))
    heard = provision.is_heard(words["SERIAL"])
    if lines or heard:
        boot = provision.boot_partition(image, lines, heard)
        source.replace(boot.begin, boot.content)
        about = [line[:60] for line in lines] + (["it listens on the serial line"] if heard else [])
        say(f"for this machine: {', '.join(about)}")
        if boot.is_out_of_reach():
            say("warning: the keys cannot log in, because the machine has no network; NETWORK='eth0 dhcp' turns it on")
    blockmap.used(image, need)  # fails if this is no image
    new = words["FILE"] == "1" and not path.exists()
    if new:
        with path.open("wb") as file:
            file.truncate(need)
    device = Device(path)  # locks the disk, also while the question waits for an answer
    try:
        if not new:
            _confirm(path, words)
    except BaseException:
        device.close()
        raise
    return Job(image, source, device, path.stat().st_size if words["FILE"] == "1" else disk.size)


def _pieces(ranges: list[Range]) -> list[Range]:
    return [Range(begin, min(begin + CHUNK, one.end)) for one in ranges for begin in range(one.begin, one.end, CHUNK)]


def write(job: Job, ranges: list[Range], progress: Progress) -> None:
    for piece in _pieces(ranges):
        size = piece.end - piece.begin
        job.device.write(piece.begin, job.source.read(piece.begin, size))
        progress.add(size)
    job.device.settle()


def verify(job: Job, ranges: list[Range], progress: Progress) -> None:
    for piece in _pieces(ranges):
        size = piece.end - piece.begin
        wanted, found = job.source.read(piece.begin, size), job.device.read(piece.begin, size)
        if wanted != found:
            offset = piece.begin + next(i for i, pair in enumerate(zip(wanted, found)) if pair[0] != pair[1])
            raise Failed(f"{job.device.path} differs from what was written at byte {offset:,}: "
                         "it is broken, or smaller than it reports")
        progress.add(size)


def flash(job: Job) -> None:
    ranges = blockmap.used(job.image, job.size)
    total = sum(one.end - one.begin for one in ranges)
    begin = time.monotonic()
    job.device.write(0, bytes(START))
    start = [Range(0, START)]
    rest = [Range(START, ranges[0].end), *ranges[1:]]
    writing, reading = Progress("writing", total), Progress("comparing", total)
    write(job, rest, writing)
    verify(job, rest, reading)
    try:
        write(job, start, writing)
        verify(job, start, reading)
    except BaseException:  # not complete after all
        with contextlib.suppress(Failed):
            job.device.write(0, bytes(START))
        raise
    if job.device.is_disk and (why := job.device.reread_partitions()):
        say(f"the kernel did not reread the partition table ({why}); unplug the disk and plug it in again")
    say(f"flash: {job.device.path} is written and compared: {target.amount(total)} of the image's "
        f"{target.amount(job.image.stat().st_size)}, {time.monotonic() - begin:.1f} s")


def _interrupt(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt


def main(arguments: list[str]) -> int:
    for name in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(name, _interrupt)
    try:
        job = prepare(parse(arguments))
    except (Failed, OSError) as error:
        say(f"flash: {error}")
        return 2
    except KeyboardInterrupt:
        say("\nflash: interrupted, nothing was written")
        return 1
    try:
        flash(job)
    except (Failed, OSError) as error:
        say(f"\nflash: {error}" if sys.stdout.isatty() else f"flash: {error}")
        return 1
    except KeyboardInterrupt:
        say("\nflash: interrupted; the disk is not complete and will not boot: flash it again")
        return 1
    finally:
        job.close()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
