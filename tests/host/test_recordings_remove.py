# SPDX-License-Identifier: GPL-2.0-or-later
"""Recordings are removed by name unless a program uses them, and read from any byte on; work shows its progress."""
from __future__ import annotations

import os
import pathlib
import signal
import subprocess

import pytest

from parts.guest.native_machine import NativeMachine

from .programs import ROOT, Desk, Process, stop, wait_until
from .test_pool import clip, index_of, recordings, start
from .test_recordings import flip, listed, record, recorded, run

pytestmark = pytest.mark.retry

__all__ = ["clip", "recorded"]  # fixtures
BLOCK = 4096
PERCENT = [f"{number} %" for number in range(1, 101)]


def begin_to_read(desk: Desk, file: pathlib.Path) -> Process:
    """Start to read a file that is larger than the pipe, so that the program waits and holds the file."""
    reader = desk.start("ddxrecordings", "read", file.name, "-folder", "rec")
    assert reader.stdout and os.read(reader.stdout.fileno(), 1)
    return reader


def test_a_recording_is_removed_and_its_files_are_used_again(desk: Desk, clip: pathlib.Path,
                                                            recorded: list[pathlib.Path]) -> None:
    record(desk, clip)
    second = [file for file in recordings(desk) if file not in recorded]
    pool = {file.stat().st_ino for file in recorded}
    done = run(desk, "remove", "video-000001")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.splitlines() == [f"{file.name}: removed" for file in recorded]
    assert recordings(desk) == second and run(desk, "verify").returncode == 0
    record(desk, clip)
    third = [file for file in recordings(desk) if file not in second]
    assert pool & {file.stat().st_ino for file in third}
    assert run(desk, "remove", second[0].name, third[1].name).returncode == 0
    assert recordings(desk) == [*second[1:], third[0], *third[2:]]


def test_what_is_being_recorded_is_not_removed(desk: Desk, clip: pathlib.Path, recorded: list[pathlib.Path]) -> None:
    saver = start(desk)
    loader = desk.start("ddxvideoload", clip, "-loop", "-readers", "1", "-rate", "0.5")
    wait_until(lambda: len(listed(desk)) == 2 and len(listed(desk)[1]["files"]) > 1)
    running = listed(desk)[1]
    done = run(desk, "remove", running["recording"], "video-000001")
    assert done.returncode == 1 and "is being recorded" in done.stderr and done.stdout == ""
    assert done.stderr.splitlines()[-1] == "ddxrecordings: nothing was removed"
    assert set(recorded) < set(recordings(desk))
    assert run(desk, "remove", running["files"][0]).returncode == 0  # is finished
    stop(loader)
    saver.kill()
    saver.wait()
    last = listed(desk)[1]["files"][-1]  # has no name before a recorder has finished it
    done = run(desk, "remove", last)
    assert done.returncode == 1 and f"{last}: not removed: its recording was interrupted" in done.stderr
    assert run(desk, "verify").returncode == 0 and running["files"][0] not in os.listdir(desk.folder / "rec")


def test_a_file_that_is_read_is_not_removed(desk: Desk, recorded: list[pathlib.Path]) -> None:
    reader = begin_to_read(desk, recorded[1])
    done = run(desk, "remove", "1")
    assert (done.returncode, done.stdout) == (1, "") and recordings(desk) == recorded
    assert done.stderr.splitlines() == [f"ddxrecordings: {recorded[1].name}: not removed: is being copied or read",
                                        "ddxrecordings: nothing was removed"]
    reader.kill()
    reader.wait()
    assert run(desk, "remove", "1").returncode == 0 and recordings(desk) == []


def test_a_file_without_an_index_is_not_removed_while_it_is_written(desk: Desk, clip: pathlib.Path) -> None:
    plain = desk.folder / "rec/plain.y4m"
    plain.write_bytes(clip.read_bytes())
    with plain.open("ab"):
        done = run(desk, "remove", plain.name)
        assert done.returncode == 1 and "is being recorded" in done.stderr and plain.exists()
    assert run(desk, "remove", plain.name).returncode == 0 and not plain.exists()


def test_other_names_are_refused(desk: Desk, recorded: list[pathlib.Path]) -> None:
    before = sorted((desk.folder / "rec").rglob("*"))
    for name in ("../clip.y4m", "pool", "pool/000001.y4m", ".", "", "no.y4m"):
        for word in ("remove", "read"):
            done = run(desk, word, name)
            assert done.returncode == 2 and "there is no such" in done.stderr and done.stdout == "", (word, name)
    assert run(desk, "remove", recorded[0].name, "no.y4m").returncode == 2
    assert sorted((desk.folder / "rec").rglob("*")) == before


def content(desk: Desk, *words: object) -> tuple[int, bytes, bytes]:
    command = [str(ROOT / "bin/ddxrecordings"), "read", *map(str, words), "-folder", "rec"]
    done = subprocess.run(command, cwd=desk.folder, env=desk.environment, capture_output=True, timeout=60, check=False)
    return done.returncode, done.stdout, done.stderr


def test_a_file_is_read_from_any_byte_on(desk: Desk, recorded: list[pathlib.Path]) -> None:
    data = recorded[0].read_bytes()
    assert content(desk, recorded[0].name) == (0, data, b"")
    for at in (0, 1, BLOCK - 1, BLOCK, (1 << 20) + 1, len(data) - 1, len(data)):
        assert content(desk, recorded[0].name, at) == (0, data[at:], b""), at
    for wrong in (len(data) + 1, "-1", "1x", 1 << 64):
        status, said, why = content(desk, recorded[0].name, wrong)
        assert (status, said, why.count(b"\n")) == (2, b"", 1), wrong


def cached(file: pathlib.Path) -> int:
    """Bytes of a file in the page cache."""
    return int(subprocess.run(["fincore", "--noheadings", "--bytes", "--output", "RES", file], capture_output=True,
                              text=True, check=True).stdout)


def test_reading_leaves_memory_to_frames(desk: Desk, recorded: list[pathlib.Path]) -> None:
    with recorded[0].open("rb") as file:
        os.fsync(file.fileno())
        os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)
    if cached(recorded[0]):
        pytest.skip("this file system is in memory")
    assert content(desk, recorded[0].name)[0] == 0 and cached(recorded[0]) == 0
    assert recorded[0].read_bytes() and cached(recorded[0])  # proves that the check can fail


def test_reading_comes_after_all_other_work(desk: Desk, recorded: list[pathlib.Path]) -> None:
    reader = begin_to_read(desk, recorded[0])
    said = subprocess.run(["ionice", "-p", str(reader.pid)], capture_output=True, text=True, check=True).stdout
    assert said.strip() == "idle" and os.getpriority(os.PRIO_PROCESS, reader.pid) == 19
    assert reader.stdout
    reader.stdout.close()  # the receiver goes away
    assert reader.wait(20) == -signal.SIGPIPE and desk.errors(reader) == ""


def test_the_machine_removes_and_reads_as_the_recorder_s_user(root: pathlib.Path, clip: pathlib.Path,
                                                              tmp_path: pathlib.Path) -> None:
    with NativeMachine(root, tmp_path) as robot:
        robot.sh("ddxctl disable ddxvideosave")
        for name in ("mine", "root-s"):
            (tmp_path / f"rec/{name}.y4m").write_bytes(clip.read_bytes())
        robot.sh("chown ddxsave:ddx /rec/mine.y4m; chmod 600 /rec/*.y4m")
        assert robot.sh("ddxctl recordings read mine.y4m 100 | sha256sum") == robot.sh(
            "tail -c +101 /rec/mine.y4m | sha256sum")
        size = (tmp_path / "rec/mine.y4m").stat().st_size
        for first in (size - 1, size, size + 1):
            counts = robot.sh(f"ddxctl recordings read -size mine.y4m {first} | wc -l -c").split()
            assert counts == ["1", str(len(f"{size}\n") + max(0, size - first))]
        status, said = robot.run("ddxctl recordings read root-s.y4m")
        assert status == 2 and said.startswith("ddxrecordings: root-s.y4m: there is no such file")
        robot.sh("chown root /rec")
        assert robot.run("ddxctl recordings remove mine.y4m") == (
            1, "ddxrecordings: mine.y4m: not removed: Permission denied")
        robot.sh("chown ddxsave /rec")
        assert robot.run("ddxctl recordings remove mine.y4m") == (0, "mine.y4m: removed")
        assert robot.sh("ls /rec/*.y4m") == "/rec/root-s.y4m"
        assert robot.run("chpst -u ddxlog ddxctl recordings remove x") == (
            1, "ddxctl: recordings remove: this needs root")


def test_progress_has_a_line_for_each_percent(desk: Desk, recorded: list[pathlib.Path], tmp_path: pathlib.Path) -> None:
    (tmp_path / "to").mkdir()
    commands: list[tuple[str, ...]] = [("verify",), ("export", "all", str(tmp_path / "to"))]
    for words in commands:
        plain, shown = run(desk, *words).stdout.splitlines(), run(desk, *words, "-progress").stdout.splitlines()
        assert [line for line in shown if line.endswith(" %")] == PERCENT and shown[-2] == PERCENT[-1]
        assert [line for line in shown if not line.endswith(" %")] == plain
    flip(recorded[0], index_of(recorded[0]).entries[0][3] + 9)
    bad = run(desk, "verify", "-progress")
    assert bad.returncode == 1 and [line for line in bad.stdout.splitlines() if line.endswith(" %")] == PERCENT
