# SPDX-License-Identifier: GPL-2.0-or-later
"""`recordings verify` and `export` find each changed byte: in the first line, in each FRAME line, in each picture, and
after the end."""
from __future__ import annotations

import pathlib
import struct

import pytest

from parts.media.crc32c import crc32c

from .programs import Desk, start_recorder, stop
from .test_pool import HEADER, index_file, index_of, recordings
from .test_recordings import flip, run

pytestmark = pytest.mark.retry

FRAMES = 2
SIDE = 4
HEAD = 2  # flag in the header: the first line has a checksum


@pytest.fixture
def file(desk: Desk) -> pathlib.Path:
    """A recording of a few hundred bytes."""
    clip = desk.folder / "clip.y4m"
    clip.write_bytes(b"YUV4MPEG2 W%d H%d F25:1\n" % (SIDE, SIDE) +
                     b"".join(b"FRAME\n" + bytes([65 + number] * (SIDE * SIDE * 3 // 2)) for number in range(FRAMES)))
    (desk.folder / "rec").mkdir()
    saver = start_recorder(desk, "-output", "rec", "-segment", "4")
    assert desk.run("ddxvideoload", clip, "-readers", "1").returncode == 0
    assert stop(saver)[0] == 0
    found, = recordings(desk)
    return found


def verify(desk: Desk) -> str:
    """Its complaints; "" if all is good."""
    done = run(desk, "verify")
    assert (done.returncode, done.stderr == "") in ((0, True), (1, False))
    return done.stderr


def test_each_changed_byte_is_found(desk: Desk, file: pathlib.Path) -> None:
    assert verify(desk) == ""
    first = index_of(file).entries[0][3]
    size = file.stat().st_size
    assert first < 100 < size < 300
    for at in range(size):
        flip(file, at)
        said = verify(desk)
        expected = "its first line" if at < first else "frame "
        assert f"{file.name}: {expected}" in said and said.count("\n") == 1, f"byte {at} of {size}: {said}"
        flip(file, at)
    assert verify(desk) == ""


def test_bytes_after_the_end_are_found(desk: Desk, file: pathlib.Path, tmp_path: pathlib.Path) -> None:
    data = file.read_bytes()
    (tmp_path / "to").mkdir()
    for more in b"\n", bytes(5000), data[index_of(file).entries[1][3]:]:
        file.write_bytes(data + more)
        assert f"{file.name}: bytes that were not recorded follow its last frame: {len(more)}\n" in verify(desk)
        done = run(desk, "export", "all", tmp_path / "to")
        assert done.returncode == 1 and "follow its last frame" in done.stderr
        assert (tmp_path / "to" / file.name).read_bytes() == data + more


def test_export_checks_the_first_line(desk: Desk, file: pathlib.Path, tmp_path: pathlib.Path) -> None:
    (tmp_path / "to").mkdir()
    assert run(desk, "export", "all", tmp_path / "to").returncode == 0
    flip(file, 0)
    done = run(desk, "export", "all", tmp_path / "to")
    assert done.returncode == 1 and f"{file.name}: its first line" in done.stderr


def without_sum(file: pathlib.Path) -> None:
    """Change the index to the form of older recorders."""
    index = index_file(file)
    data = bytearray(index.read_bytes())
    fields = list(HEADER.unpack_from(data))
    assert fields[13] & HEAD
    fields[13] &= ~HEAD
    fields[14] = fields[15] = 0
    HEADER.pack_into(data, 0, *fields)
    struct.pack_into("<I", data, HEADER.size - 4, crc32c(bytes(data[:HEADER.size - 4])))
    index.write_bytes(data)


def test_an_index_of_an_older_recorder(desk: Desk, file: pathlib.Path) -> None:
    """The file has no checksum of the first line, which must still be valid for pictures of that size."""
    without_sum(file)
    assert verify(desk) == ""
    data = file.read_bytes()
    for old, new in (b"W4 ", b"W64"), (b"YUV4MPEG2", b"YUV5MPEG2"), (b"W4 ", b"WX "), (b"C420", b"C422"):
        file.write_bytes(data.replace(old, new, 1))
        assert f"{file.name}: its first line" in verify(desk)


def test_a_damaged_index_or_magic_is_reported(desk: Desk, file: pathlib.Path) -> None:
    flip(index_file(file), 20)
    assert "its index is damaged: no frame has its sum" in verify(desk)
    flip(file, 0)
    assert "its index is damaged: no frame has its sum" in verify(desk)
    flip(file, 0)
    flip(index_file(file), 20)
    assert verify(desk) == ""
    plain = file.with_name("video-000009-20261126T092122Z.y4m")  # of a recorder without a pool
    plain.write_bytes(b"X" + file.read_bytes()[1:])
    assert f"{plain.name}: after 0 whole frames comes something else" in verify(desk)
