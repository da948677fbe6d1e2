# SPDX-License-Identifier: GPL-2.0-or-later
"""Every write and flush of a guest, in the order in which they were finished, as QEMU's blklogwrites wrote them down
(the format of Linux's dm-log-writes); and what a disk may hold after a power cut between two of them."""
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
Writes = list[tuple[int, bytes]]  # where, and what


@dataclasses.dataclass(frozen=True)
class Entry:
    """A write, a flush, or both; where it begins, in bytes."""
    offset: int
    data: bytes
    flags: int

    @property
    def is_flush(self) -> bool:
        return bool(self.flags & FLUSH)


def entries(log: pathlib.Path) -> Iterator[Entry]:
    """All that were written down; QEMU has to have ended."""
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
    """A piece of a disk, as the writes make it; and as a power cut may leave it."""

    def __init__(self, begin: int, content: bytes) -> None:
        self.begin, self.safe = begin, bytearray(content)
        self._since: Writes = []  # what no flush has made safe yet

    def _part(self, entry: Entry) -> tuple[int, bytes] | None:
        """What of a write lies in this piece."""
        begin, end = max(entry.offset, self.begin), min(entry.offset + len(entry.data), self.begin + len(self.safe))
        return (begin - self.begin, entry.data[begin - entry.offset:end - entry.offset]) if begin < end else None

    def _put(self, writes: Writes) -> None:
        for at, data in writes:
            self.safe[at:at + len(data)] = data

    def add(self, entry: Entry) -> bool:
        """The next one; whether it changed anything here."""
        if entry.is_flush:
            self._put(self._since)
            self._since.clear()
        part = self._part(entry)
        if part and entry.flags & FUA:  # safe by itself, whatever came before it
            self._put([part])
        if part:
            self._since.append(part)
        return part is not None or entry.is_flush

    def all_written(self) -> Writes:
        """A power cut now, and of what was written since the last flush all that was finished is there."""
        return list(self._since)

    def some_written(self, chance: random.Random) -> Writes:
        """Some of it is there, some is not, some in part."""
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
        """What such a power cut leaves, as a file with holes: most of a disk is empty, and thousands are made."""
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
