# SPDX-License-Identifier: GPL-2.0-or-later
"""The log of a guest's finished writes and flushes, as QEMU's blklogwrites writes it (format of Linux's dm-log-writes),
and the possible contents of a disk after a power cut between two of them."""
import dataclasses
import pathlib
import random
import struct
from collections.abc import Iterator

MAGIC, VERSION = 0x6A736677736872, 1
FLUSH, FUA, DISCARD = 1, 2, 4
SUPER = struct.Struct("<QQQI")
HEAD = struct.Struct("<QQQQ")
SECTOR = 512
EMPTY = bytes(1 << 20)
Writes = list[tuple[int, bytes]]  # offset and data


@dataclasses.dataclass(frozen=True)
class Entry:
    """A write, a flush, or both, at an offset in bytes."""
    offset: int
    data: bytes
    flags: int

    @property
    def is_flush(self) -> bool:
        return bool(self.flags & FLUSH)


def entries(log: pathlib.Path) -> Iterator[Entry]:
    """All entries of a log, after QEMU has exited."""
    with log.open("rb") as file:
        magic, version, count, sector = SUPER.unpack(file.read(SUPER.size))
        if (magic, version) != (MAGIC, VERSION):
            raise ValueError(f"{log}: not a log of writes")
        file.seek(sector)
        for _ in range(count):
            first, sectors, flags, _ = HEAD.unpack(file.read(HEAD.size))
            file.seek(sector - HEAD.size, 1)
            length = sectors * sector
            data = b"" if flags & DISCARD else file.read(length)
            yield Entry(first * sector, data, flags)


class LoggedDisk:
    """A part of a disk with the logged writes, and its possible contents after a power cut."""

    def __init__(self, begin: int, content: bytes) -> None:
        self.begin, self.safe = begin, bytearray(content)
        self._since: Writes = []  # not yet flushed

    def _part(self, entry: Entry) -> tuple[int, bytes] | None:
        """The part of a write inside this part of the disk."""
        begin, end = max(entry.offset, self.begin), min(entry.offset + len(entry.data), self.begin + len(self.safe))
        return (begin - self.begin, entry.data[begin - entry.offset:end - entry.offset]) if begin < end else None

    def _put(self, writes: Writes) -> None:
        for at, data in writes:
            self.safe[at:at + len(data)] = data

    def add(self, entry: Entry) -> bool:
        """Apply the next entry; returns whether it changed anything here."""
        if entry.is_flush:
            self._put(self._since)
            self._since.clear()
        part = self._part(entry)
        if part and entry.flags & FUA:  # durable without a flush
            self._put([part])
        if part:
            self._since.append(part)
        return part is not None or entry.is_flush

    def all_written(self) -> Writes:
        """A power cut now, after which all writes since the last flush are present."""
        return list(self._since)

    def some_written(self, chance: random.Random) -> Writes:
        """A power cut now, after which some writes since the last flush are present, some in part."""
        found: Writes = []
        for at, data in self._since:
            whole = chance.random()
            if whole < 0.4:
                found.append((at, data))
            elif whole < 0.7:
                sectors = [sector for sector in range(0, len(data), SECTOR) if chance.random() < 0.5]
                found.extend((at + sector, data[sector:sector + SECTOR]) for sector in sectors)
        return found

    def make(self, image: pathlib.Path, written: Writes) -> None:
        """Write the disk after such a power cut as a sparse file: thousands of mostly empty disks are made."""
        with image.open("wb") as file:
            file.truncate(len(self.safe))
            for at in range(0, len(self.safe), len(EMPTY)):
                piece = self.safe[at:at + len(EMPTY)]
                if piece != EMPTY[:len(piece)]:
                    file.seek(at)
                    file.write(piece)
            for at, data in written:
                file.seek(at)
                file.write(data)
