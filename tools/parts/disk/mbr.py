# SPDX-License-Identifier: GPL-2.0-or-later
"""The partitions of an MBR disk, in a file or on a device."""
import dataclasses
import pathlib
import struct

from parts.common import Failed

SECTOR = 512
EXTENDED = (0x05, 0x0F, 0x85)
MOST = 60  # logical partitions; a table that goes round in circles ends here


@dataclasses.dataclass(frozen=True)
class Partition:
    number: int
    kind: int
    begin: int  # in bytes
    end: int


def partitions(disk: pathlib.Path) -> list[Partition]:
    """Those that hold something: without the extended one, which holds the logical ones (5 and up)."""
    with disk.open("rb") as file:

        def entries(sector: int) -> list[tuple[int, int, int]]:
            file.seek(sector * SECTOR + 446)
            table = file.read(66)
            if table[64:] != b"\x55\xaa":
                raise Failed(f"{disk}: no partition table in sector {sector}")
            return [(kind, first, count) for kind, first, count in struct.iter_unpack("<4xB3xII", table[:64])]

        found = []

        def add(number: int, kind: int, first: int, count: int) -> None:
            if kind and count:
                found.append(Partition(number, kind, first * SECTOR, (first + count) * SECTOR))

        for index, (kind, first, count) in enumerate(entries(0), 1):
            if kind not in EXTENDED:
                add(index, kind, first, count)
                continue
            link = first
            for number in range(5, 5 + MOST):
                table = entries(link)
                add(number, table[0][0], link + table[0][1], table[0][2])
                if not table[1][0]:
                    break
                link = first + table[1][1]
    return sorted(found, key=lambda partition: partition.number)


def partition(disk: pathlib.Path, number: int) -> Partition:
    for one in partitions(disk):
        if one.number == number:
            return one
    raise Failed(f"{disk}: no partition {number}")
