# SPDX-License-Identifier: GPL-2.0-or-later
"""Reads the index of a recording's file; package/ddxvideo/save/pool/index.h has its layout."""
import dataclasses
import struct

from parts.common import Failed

HEADER = struct.Struct("<8sIIQQqqQQII128s192sIHHII")
ENTRY = struct.Struct("<QQqQIIIiIIHHI")
BLOCK = 4096
NAMED = 4


@dataclasses.dataclass(frozen=True)
class Entry:
    sequence: int  # in the store
    lost_store: int  # frames lost before this one
    lost_ring: int
    lost_encode: int

    @property
    def lost(self) -> int:
        return self.lost_store + self.lost_ring + self.lost_encode


@dataclasses.dataclass(frozen=True)
class Index:
    """The index of a finished file."""
    bytes: int
    lost_store: int  # frames lost, also after the file's last frame
    lost_ring: int
    lost_encode: int
    name: str
    entries: list[Entry]

    @property
    def lost(self) -> int:
        return self.lost_store + self.lost_ring + self.lost_encode


def parse(data: bytes) -> Index:
    magic, state, frames, recording, size, _, _, store, ring, _, _, _, name, _, _, encode, *_ = HEADER.unpack_from(data)
    if magic != b"DDXINDX1" or state != NAMED:
        raise Failed("no index of a finished recording")
    entries = []
    for position in range(frames):
        one, sequence, _, _, _, _, number, _, lost_store, lost_ring, _, lost_encode, _ = ENTRY.unpack_from(
            data, BLOCK + position * ENTRY.size)
        if (one, number) != (recording, position):
            raise Failed(f"entry {position} of the index is foreign")
        entries.append(Entry(sequence, lost_store, lost_ring, lost_encode))
    return Index(size, store, ring, encode, name.rstrip(b"\0").decode(), entries)
