# SPDX-License-Identifier: GPL-2.0-or-later
"""A log truncated by a power cut: all whole chunks are recovered, and a failed recovery changes nothing."""
from __future__ import annotations

import pathlib
import subprocess

import pytest

from lib import logs

from .log_rules import CONFIG, begin, check_log, only, write, written
from .programs import ROOT, Compiler, Desk, library_folder, stop, wait_until

pytestmark = pytest.mark.retry


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory, compile_client: Compiler) -> pathlib.Path:
    """A log of three seconds, with at least three chunks."""
    desk = Desk(tmp_path_factory.mktemp("whole"))
    try:
        logger = begin(desk)
        written(desk, write(desk, compile_client, "imu", 300, 10000))
        assert stop(logger)[0] == 0
        return only(desk)
    finally:
        desk.end()


def ddxlog(*arguments: object, prefix: tuple[str, ...] = ()) -> subprocess.CompletedProcess[str]:
    return subprocess.run([*prefix, str(ROOT / "bin/ddxlog"), *map(str, arguments)], capture_output=True, text=True,
                          timeout=60, env={"LD_LIBRARY_PATH": str(library_folder()), "PATH": "/usr/bin:/bin"})


def contents(log: logs.Log) -> list[tuple[str, int, int, bytes]]:
    return sorted((topic, one.sequence, one.publish_time, one.data) for topic, values in log.values.items()
                  for one in values)


def in_chunks(whole: pathlib.Path, log: logs.Log, size: int) -> list[tuple[str, int, int, bytes]]:
    """The expected contents of the first `size` bytes: the messages of whole chunks, by mcap's index."""
    last = max((chunk.message_end_time for chunk in log.chunks
                if chunk.chunk_start_offset + chunk.chunk_length <= size), default=-1)
    ends = sorted(chunk.message_end_time for chunk in log.chunks)
    assert ends == [chunk.message_end_time for chunk in log.chunks]  # times must identify chunks
    return sorted((topic, one.sequence, one.publish_time, one.data) for topic, values in log.values.items()
                  for one in values if one.log_time <= last)


@pytest.mark.parametrize("tail", [b"", b"\0" * 5000, b"\0" * 3], ids=["cut", "zeros", "few"])
def test_every_whole_chunk_is_recovered(whole: pathlib.Path, tmp_path: pathlib.Path, tail: bytes) -> None:
    log, data = logs.read(whole), whole.read_bytes()
    assert len(log.chunks) >= 3
    edges = [edge for chunk in log.chunks for edge in (chunk.chunk_start_offset,
                                                       chunk.chunk_start_offset + chunk.chunk_length)]
    cuts = {edge + shift for edge in edges for shift in (-1, 0, 1, 9)} | set(range(100, len(data), len(data) // 40))
    cuts |= {len(data) - shift for shift in (1, 8, 9, 20, 40)}
    path = tmp_path / "cut.mcap"
    full = 0
    for cut in sorted(cuts):
        if not 100 <= cut < len(data):
            continue
        path.write_bytes(data[:cut] + tail)
        # A chunk ends with zeros, so some of the appended ones may belong to it.
        cut += next((n for n, byte in enumerate(data[cut:cut + len(tail)]) if byte), min(len(tail), len(data) - cut))
        done = ddxlog("-recover", path)
        assert done.returncode == 0, (cut, done.stderr)
        found = logs.read(path)
        assert contents(found) == in_chunks(whole, log, cut), cut
        assert "ddxlog.recovered" in found.metadata
        assert not found.order or found.wall_offset == log.wall_offset
        full += bool(found.order)
        assert [one.name for one in tmp_path.iterdir()] == ["cut.mcap"]
    assert full > 20
    assert ddxlog("-recover", path).stderr.endswith("is complete, nothing to do\n")


def test_the_check_finds_a_missing_chunk(whole: pathlib.Path, tmp_path: pathlib.Path) -> None:
    """The test above with a recovery that loses a chunk."""
    log, path = logs.read(whole), tmp_path / "cut.mcap"
    last = log.chunks[-1]
    path.write_bytes(whole.read_bytes()[:last.chunk_start_offset + 20])
    assert ddxlog("-recover", path).returncode == 0
    size = last.chunk_start_offset + last.chunk_length
    assert contents(logs.read(path)) != in_chunks(whole, log, size)


def test_with_damage_in_the_middle_the_old_file_is_kept(whole: pathlib.Path, tmp_path: pathlib.Path) -> None:
    log, path = logs.read(whole), tmp_path / "cut.mcap"
    data = bytearray(whole.read_bytes()[:-30])
    chunk = log.chunks[1]
    data[chunk.chunk_start_offset + chunk.chunk_length // 2] ^= 0x40
    path.write_bytes(data)
    done = ddxlog("-recover", path)
    assert done.returncode == 0 and "damaged" in done.stderr
    assert (tmp_path / "cut.mcap.damaged").read_bytes() == data
    kept = [one for one in in_chunks(whole, log, len(data))]
    found = contents(logs.read(path))
    assert set(found) < set(kept) and len(found) >= len(kept) * (len(log.chunks) - 1) // len(log.chunks) - 110


def test_a_recovery_that_fails_changes_nothing(whole: pathlib.Path, tmp_path: pathlib.Path) -> None:
    """The disk has no room for the copy."""
    path = tmp_path / "cut.mcap"
    data = whole.read_bytes()[:-100]
    path.write_bytes(data)
    done = ddxlog("-recover", path, prefix=("prlimit", "--fsize=5000"))
    assert done.returncode == 1 and "is unchanged" in done.stderr
    assert path.read_bytes() == data and [one.name for one in tmp_path.iterdir()] == ["cut.mcap"]


@pytest.mark.parametrize("content", [b"", b"\x89MCAP0\r", b"RIFF" * 100, b"\0" * 10000])
def test_files_that_are_no_log(tmp_path: pathlib.Path, content: bytes) -> None:
    path = tmp_path / "no.mcap"
    path.write_bytes(content)
    for arguments in (["-recover", path], ["-replay", path], ["-export", tmp_path / "out", path]):
        done = ddxlog(*arguments)
        assert done.returncode == 2 and done.stderr.count("\n") == 1 and str(path) in done.stderr
    assert path.read_bytes() == content and not (tmp_path / "out").exists()


def test_the_next_start_recovers(desk: Desk, compile_client: Compiler) -> None:
    """After a kill, all flushed values are readable once the next logger has started."""
    logger = begin(desk)
    writer = write(desk, compile_client, "imu", 400, 10000)
    wait_until(lambda: desk.out("ddxlog") > 100)
    safe = desk.out("ddxlog")
    logger.kill()
    logger.wait()
    writer.terminate()
    path = only(desk)
    with pytest.raises(Exception):  # noqa: B017  of mcap: the end record is missing
        logs.read(path)
    second = begin(desk)
    wait_until(lambda: "was truncated; repaired" in desk.errors(second))
    assert stop(second)[0] == 0
    log = logs.read(path)
    stamps = log.monotonic("imu")
    expected = [(n + 1, stamp) for n, stamp in enumerate(stamps)]
    check_log(log, "imu", expected)
    assert len(stamps) >= safe  # values counted as out are on the disk


def test_a_file_that_is_being_written_is_left_alone(desk: Desk, compile_client: Compiler) -> None:
    logger = begin(desk, CONFIG)
    writer = write(desk, compile_client, "imu", 100, 20000)
    wait_until(lambda: (desk.folder / "log").exists() and any((desk.folder / "log").iterdir()))
    done = desk.run("ddxlog", "-recover", only(desk))
    assert done.returncode == 1 and "is being written" in done.stderr
    other = begin(desk, CONFIG, "ddxlog.other")
    expected = written(desk, writer)
    assert stop(other)[0] == 0 and stop(logger)[0] == 0
    log = logs.read(next((desk.folder / "log").glob("ddxlog-0*")))
    check_log(log, "imu", expected)
