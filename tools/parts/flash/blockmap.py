# SPDX-License-Identifier: GPL-2.0-or-later
"""Which parts of a disk image have to be written, zeros or not, so that the disk works whatever was on it before.

A hole in the image file is not the same as unused: genimage makes holes of zeros that a file system relies on, such as
empty inode tables, the journal, and free entries of the FAT. So the map is made the other way round: everything is
written, except what a partition's own file system calls free. And never left out are the ends of each partition and of
the disk, where other systems keep signatures that would be found beside ours.
"""
import dataclasses
import pathlib
import re
import struct
from collections.abc import Iterable

from parts.common import output
from parts.disk import mbr

BLOCK = 64 * 1024          # writing less than that at once is not faster
HEAD = 4 * 2**20 + BLOCK   # of a partition: LUKS keeps a second header as far in as 4 MiB, all others are nearer
TAIL = 2**20               # of a partition and of the disk: GPT's second header, md, ZFS


@dataclasses.dataclass(frozen=True)
class Range:
    begin: int
    end: int


def _bytes(ranges: Iterable[Range]) -> int:
    return sum(one.end - one.begin for one in ranges)


def _is_zero(image: pathlib.Path, begin: int, end: int) -> bool:
    with image.open("rb") as file:
        file.seek(begin)
        while begin < end:
            data = file.read(min(2**20, end - begin))
            if data.strip(b"\0"):
                return False
            if not data:
                break
            begin += len(data)
    return True


def _free_in_ext4(image: pathlib.Path, begin: int) -> list[Range]:
    """What the block bitmaps call free; nothing if there is any doubt about them."""
    text = output(["dumpe2fs", f"{image}?offset={begin}"])
    head = dict(re.findall(r"^([A-Z][a-z ]+):\s+(.*)$", text, re.M))
    features = head.get("Filesystem features", "bigalloc").split()
    if head.get("Filesystem state") != "clean" or {"bigalloc", "needs_recovery"} & set(features):
        return []
    size = int(head["Block size"])
    ranges = []
    for line in re.findall(r"^  Free blocks: (.*)$", text, re.M):
        for first, last in re.findall(r"(\d+)(?:-(\d+))?", line):
            ranges.append(Range(begin + int(first) * size, begin + (int(last or first) + 1) * size))
    return ranges if _bytes(ranges) == int(head["Free blocks"]) * size else []


def _free(image: pathlib.Path, partition: mbr.Partition) -> list[Range]:
    """The parts of a partition whose contents are not read before they are written."""
    with image.open("rb") as file:
        file.seek(partition.begin)
        head = file.read(2048)
    if head[1080:1082] == b"\x53\xef":
        return _free_in_ext4(image, partition.begin)
    begin = partition.begin
    if head[:4] == b"hsqs":  # squashfs tells its length; after it, and in an empty slot, there is nothing
        length: int = struct.unpack_from("<Q", head, 40)[0]
        begin += length
    return [Range(begin, partition.end)] if _is_zero(image, begin, partition.end) else []


def used(image: pathlib.Path, disk_size: int) -> list[Range]:
    """What has to be written on a disk of that size, in order. Beyond the image's end: zeros."""
    holes = []
    for partition in mbr.partitions(image):
        for one in _free(image, partition):
            begin = max(one.begin, partition.begin + HEAD)
            end = min(one.end, partition.end - TAIL)
            holes.append(Range(-(-begin // BLOCK) * BLOCK, end // BLOCK * BLOCK))
    image_end = image.stat().st_size
    tail = max(image_end, (disk_size - TAIL) // BLOCK * BLOCK)
    holes.append(Range(image_end, tail))  # the recordings will grow into it; growing writes what it needs
    ranges = []
    position = 0
    for hole in sorted(holes, key=lambda one: one.begin):
        if hole.end <= hole.begin:
            continue
        if position < hole.begin:
            ranges.append(Range(position, hole.begin))
        position = max(position, hole.end)
    if position < disk_size:
        ranges.append(Range(position, disk_size))
    return ranges
