# SPDX-License-Identifier: GPL-2.0-or-later
"""The parts of a disk image that must be written, zeros or not, whatever the disk's former content.

A hole in the image file is not unused space: genimage makes holes of zeros that a file system relies on, such as empty
inode tables, the journal, and free entries of the FAT. So everything is written except the space that a partition's
file system calls free. The ends of each partition and of the disk are always written, since other systems keep
signatures there that would be found beside ours.
"""
import dataclasses
import pathlib
import re
import struct
from parts.common import output
from parts.disk import mbr

BLOCK = 64 * 1024          # smaller writes are not faster
HEAD = 4 * 2**20 + BLOCK   # of a partition: LUKS keeps a second header at up to 4 MiB, others are nearer
TAIL = 2**20               # of a partition and of the disk: GPT's second header, md, ZFS


@dataclasses.dataclass(frozen=True)
class Range:
    begin: int
    end: int


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
    """Free space according to the block bitmaps; none if these are doubtful."""
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
    return ranges if sum(one.end - one.begin for one in ranges) == int(head["Free blocks"]) * size else []


def _free(image: pathlib.Path, partition: mbr.Partition) -> list[Range]:
    """The parts of a partition whose contents are not read before they are written."""
    with image.open("rb") as file:
        file.seek(partition.begin)
        head = file.read(2048)
    if head[1080:1082] == b"\x53\xef":
        return _free_in_ext4(image, partition.begin)
    begin = partition.begin
    if head[:4] == b"hsqs":  # squashfs has its length in the header; the rest, and an empty slot, is zeros
        length: int = struct.unpack_from("<Q", head, 40)[0]
        begin += length
    return [Range(begin, partition.end)] if _is_zero(image, begin, partition.end) else []


def used(image: pathlib.Path, disk_size: int) -> list[Range]:
    """The ranges to write on a disk of that size, in order; zeros after the image's end."""
    holes = []
    for partition in mbr.partitions(image):
        for one in _free(image, partition):
            begin = max(one.begin, partition.begin + HEAD)
            end = min(one.end, partition.end - TAIL)
            holes.append(Range(-(-begin // BLOCK) * BLOCK, end // BLOCK * BLOCK))
    image_end = image.stat().st_size
    tail = max(image_end, (disk_size - TAIL) // BLOCK * BLOCK)
    holes.append(Range(image_end, tail))  # for the recordings; growing their file system writes what it needs
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
