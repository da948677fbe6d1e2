# SPDX-License-Identifier: GPL-2.0-or-later
"""MP4 recordings, read by the standards (ISO/IEC 14496-12, -15, H.264) and not by our reader."""
from __future__ import annotations

import json
import pathlib
import struct
import subprocess
from collections.abc import Iterator
from typing import Any, NamedTuple

UUID = bytes.fromhex("6f2b8d1e94574ca3b03d5e71c826da49")
NESTED = {b"moov", b"trak", b"mdia", b"minf", b"stbl", b"mvex", b"moof", b"traf"}


class Frame(NamedTuple):
    offset: int
    size: int
    time: int  # us
    key: bool


class Stamp(NamedTuple):
    sequence: int
    frame: int
    source_sequence: int
    time: int
    wall: int
    lost_store: int
    lost_ring: int
    lost_encode: int
    geometry: tuple[int, ...]


def boxes(data: bytes, at: int = 0, end: int | None = None) -> Iterator[tuple[bytes, int, int]]:
    """Type, and begin and end of the content, of each box here and of those inside."""
    end = len(data) if end is None else end
    while at + 8 <= end:
        size, kind = struct.unpack_from(">I4s", data, at)
        begin = at + 8
        if size == 1:
            size, = struct.unpack_from(">Q", data, begin)
            begin += 8
        if at + size > end:
            break
        yield kind, begin, at + size
        if kind in NESTED:
            yield from boxes(data, begin, at + size)
        at += size


def top(data: bytes) -> list[str]:
    """The boxes of the file itself."""
    kinds, at = [], 0
    while at + 8 <= len(data):
        size, kind = struct.unpack_from(">I4s", data, at)
        kinds.append(kind.decode())
        at += struct.unpack_from(">Q", data, at + 8)[0] if size == 1 else size
    return kinds


def fragments(data: bytes) -> list[Frame]:
    """The whole frames behind block 0."""
    found, moof, time, size, flags = [], 0, 0, 0, 0
    for kind, begin, end in boxes(data, 4096):
        if kind == b"moof":
            moof = begin - 8
        elif kind == b"tfdt":
            time, = struct.unpack_from(">Q", data, begin + 4)
        elif kind == b"trun":
            offset, _, size, flags = struct.unpack_from(">IIII", data, begin + 8)
            assert offset + moof == end + 8
        elif kind == b"mdat":
            assert size == end - begin
            found.append(Frame(begin, size, time, not flags & 0x10000))
    return found


def table(data: bytes) -> tuple[list[Frame], int]:
    """The frames that the table of a finished file lists, and how long the film is."""
    moov = data.rindex(b"moov") - 4
    parts = {kind: data[begin + 4:end] for kind, begin, end in boxes(data, moov)}
    count, = struct.unpack_from(">I", parts[b"stsz"], 4)
    sizes = struct.unpack_from(f">{count}I", parts[b"stsz"], 8)
    offsets = struct.unpack_from(f">{count}Q", parts[b"co64"], 4)
    runs = struct.unpack(f">{len(parts[b'stts']) // 4 - 1}I", parts[b"stts"][4:])
    steps = [step for number, step in zip(runs[::2], runs[1::2]) for _ in range(number)]
    keys = struct.unpack(f">{len(parts[b'stss']) // 4 - 1}I", parts[b"stss"][4:])
    assert len(steps) == count and struct.unpack_from(">IIII", parts[b"stsc"]) == (1, 1, 1, 1)
    times = [sum(steps[:number]) for number in range(count)]
    return [Frame(offset, size, time, number + 1 in keys) for number, (offset, size, time)
            in enumerate(zip(offsets, sizes, times))], sum(steps)


def stamp(data: bytes, frame: Frame) -> Stamp:
    """The user data of a frame: without the bytes 3 that H.264 puts after two zeros."""
    at = frame.offset
    size, = struct.unpack_from(">I", data, at)
    nal = data[at + 4:at + 4 + size]
    assert nal[0] & 31 == 6, "no SEI before the picture"
    plain = nal.replace(b"\0\0\3", b"\0\0")
    assert plain[1] == 5 and plain[3:19] == UUID and plain[19] == 1
    numbers = struct.unpack_from(">QqqqqIII", plain, 21)
    return Stamp._make((*numbers, struct.unpack_from(">10i", plain, 73) if plain[20] else ()))


def stamps(path: pathlib.Path) -> list[Stamp]:
    data = path.read_bytes()
    return [stamp(data, frame) for frame in fragments(data)]


def probe(path: pathlib.Path) -> dict[str, Any]:
    """The stream and its decoded frames, as ffprobe finds them."""
    done = subprocess.run(["ffprobe", "-v", "error", "-show_streams", "-show_frames", "-of", "json", path],
                          capture_output=True, text=True, check=True, timeout=60)
    assert done.stderr == ""
    return dict(json.loads(done.stdout))


def shown(path: pathlib.Path) -> list[int]:
    """The times of the frames for a player, us."""
    return [round(float(frame["pts_time"]) * 1_000_000) for frame in probe(path)["frames"]]
