# SPDX-License-Identifier: GPL-2.0-or-later
"""A small log may declare gigabytes: ddxlog uses bounded memory, names skipped records, and reads the rest. The logs
are made here byte by byte."""
from __future__ import annotations

import pathlib
import struct
import subprocess

import lz4.frame  # type: ignore[import]
import pytest

from . import log_rules
from .programs import ROOT, TOP, Desk, library_folder, stop, wait_until

pytestmark = pytest.mark.strict

MIB = 1 << 20
LIMIT = 200 * MIB  # address space; these logs once took 3 to 10 times as much
MAGIC = b"\x89MCAP0\r\n"


def record(opcode: int, content: bytes) -> bytes:
    return bytes([opcode]) + struct.pack("<Q", len(content)) + content


def text(value: str) -> bytes:
    return struct.pack("<I", len(value)) + value.encode()


def schema(number: int, data: bytes) -> bytes:
    return record(3, struct.pack("<H", number) + text("s") + text("") + struct.pack("<I", len(data)) + data)


def channel(number: int) -> bytes:
    pairs = text("ddx.type") + text("T") + text("ddx.declaration") + text("struct { int32_t a; }")
    return record(4, struct.pack("<HH", number, 0) + text(f"t{number}") + text("cdr") + struct.pack("<I", len(pairs))
                  + pairs)


def message(number: int, time: int, data: bytes) -> bytes:
    return record(5, struct.pack("<HIQQ", 1, number, time, time) + data)


def value(number: int) -> bytes:
    return struct.pack("<Ii", 1 << 8, number)


def chunk(first: int, records: bytes) -> bytes:
    packed = lz4.frame.compress(records, block_size=lz4.frame.BLOCKSIZE_MAX4MB)
    return record(6, struct.pack("<QQQI", first, first, len(records), 0) + text("lz4")
                  + struct.pack("<Q", len(packed)) + packed)


def log(*records: bytes) -> bytes:
    """A log without its end record, as after a power cut."""
    return MAGIC + record(1, text("") + text("")) + b"".join(records)


WRITE = """
import ddx
with ddx.Store() as store, store.create("large", "LARGE", "struct { char x[%d]; }") as item, item.loan():
    pass
"""
END = record(15, bytes(4)) + record(2, bytes(20)) + MAGIC


def ddxlog(*arguments: object) -> tuple[int, str]:
    """Run ddxlog in little memory; return its exit status and messages."""
    environment = {"LD_LIBRARY_PATH": str(library_folder()), "PATH": "/usr/bin:/bin"}
    done = subprocess.run(["prlimit", f"--as={LIMIT}", ROOT / "bin/ddxlog", *map(str, arguments)], env=environment,
                          capture_output=True, text=True, timeout=60)
    return done.returncode, done.stderr


def table(folder: pathlib.Path) -> list[int]:
    return [int(line.split(",")[-1]) for line in (folder / "t1.csv").read_text().splitlines()[1:]]


def test_chunks_that_overlap_in_time(tmp_path: pathlib.Path) -> None:
    """Each chunk has an early and a late value, so all of them are needed at the same time."""
    path, count = tmp_path / "overlap.mcap", 6
    padding = message(0, 50, bytes(40 * MIB))  # wrong size for its type, so it adds no row
    path.write_bytes(log(channel(1), *(chunk(i, message(i, i, value(i)) + padding + message(i, 100 + i, value(100 + i)))
                                       for i in range(count))) + END)
    status, said = ddxlog("-export", tmp_path / "out", path)
    assert status == 0 and f"{count} messages of the wrong size" in said
    assert table(tmp_path / "out") == [*range(count), *range(100, 100 + count)]


@pytest.mark.parametrize("action", ["-export", "-recover"])
def test_a_chunk_that_is_too_large(tmp_path: pathlib.Path, action: str) -> None:
    path = tmp_path / "large.mcap"
    begin = log(channel(1), chunk(1, message(1, 1, value(1))))
    whole = begin + chunk(2, message(2, 2, bytes(200 * MIB))) + chunk(3, message(3, 3, value(3)))
    path.write_bytes(whole)
    assert len(whole) < 2 * MIB
    if action == "-recover":
        status, said = ddxlog("-recover", path)
        assert status == 0 and "kept as .damaged" in said
        assert (tmp_path / "large.mcap.damaged").read_bytes() == whole
        assert f"{path}: the record at byte {len(begin)} " in said
    status, said = ddxlog("-export", tmp_path / "out", path)
    assert status == 0 and table(tmp_path / "out") == [1, 3]
    assert action == "-recover" or f"{path}: the record at byte {len(begin)} " in said


def test_the_last_chunk_is_too_large(tmp_path: pathlib.Path) -> None:
    """This is not a power cut: the old file is kept, for a program that can read such a chunk."""
    path = tmp_path / "large.mcap"
    whole = log(channel(1), chunk(1, message(1, 1, value(1))), chunk(2, message(2, 2, bytes(65 * MIB))))
    path.write_bytes(whole)
    status, said = ddxlog("-recover", path)
    assert status == 0 and "1 messages" in said
    assert (tmp_path / "large.mcap.damaged").read_bytes() == whole


def test_schemas_within_chunks(tmp_path: pathlib.Path) -> None:
    """Definitions stay in memory after their chunk, so their total is limited."""
    path = tmp_path / "schemas.mcap"
    schemas = (b"".join(schema(20 * i + k + 1, bytes(MIB)) for k in range(20)) for i in range(20))
    path.write_bytes(log(channel(1), chunk(0, message(0, 0, value(0))), *(chunk(1, part) for part in schemas),
                         chunk(2, message(2, 2, value(2)))) + END)
    status, said = ddxlog("-export", tmp_path / "out", path)
    assert status == 0 and table(tmp_path / "out") == [0, 2]
    assert "the record at byte" in said and "others" in said


def test_columns_of_many_channels(tmp_path: pathlib.Path) -> None:
    """A short declaration may have 65536 fields."""
    path = tmp_path / "columns.mcap"
    declaration = "struct { struct { struct { int8_t x; } a[256]; } b[256]; }"
    pairs = text("ddx.type") + text("T") + text("ddx.declaration") + text(declaration)
    wide = (record(4, struct.pack("<HH", i, 0) + text(f"wide{i}") + text("cdr") + struct.pack("<I", len(pairs)) + pairs)
            for i in range(2, 42))
    values = (record(5, struct.pack("<HIQQ", i, i, i, i)) for i in range(2, 42))
    path.write_bytes(log(channel(1), *wide, chunk(1, message(1, 1, value(1)) + b"".join(values))) + END)
    status, said = ddxlog("-export", tmp_path / "out", path)
    assert status == 0 and table(tmp_path / "out") == [1]
    assert "wide41: left out" in said


def test_a_value_too_large_to_read_is_not_logged(tmp_path: pathlib.Path) -> None:
    """The logger writes no value that replay and tables would refuse."""
    desk = Desk(tmp_path, "512M")
    try:
        logger = log_rules.begin(desk, "output log\nqueue 1M\nitem large\n")
        subprocess.run(["/usr/bin/python3", "-B", "-c", WRITE % (64 * MIB)], check=True,
                       env={**desk.environment, "PYTHONPATH": str(TOP / "package/ddx/python")})
        wait_until(lambda: int(desk.stats("ddxlog")["lost"]["queue"]) == 1)
        assert stop(logger)[0] == 0
        assert "losing values of large from 1 on: one is larger than what a log can hold" in desk.errors(logger)
    finally:
        desk.end()
