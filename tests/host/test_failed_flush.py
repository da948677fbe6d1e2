# SPDX-License-Identifier: GPL-2.0-or-later
"""The disk loses written data and, like Linux, reports it once. A later successful flush proves nothing: frames written
since the last good flush are counted as lost and are not in the file."""
from __future__ import annotations

import pathlib

import pytest

from lib import logs

from .log_rules import begin, only, write
from .programs import Compiler, Desk, lost, pictures, preload, result, start_recorder, wait_until
from .test_faults import clip
from .test_pool import recordings
from .test_recordings import run

pytestmark = pytest.mark.strict

__all__ = ["clip"]  # a fixture


class Disk:
    def __init__(self, folder: pathlib.Path) -> None:
        self.failure, self.flushes = folder / "failure", folder / "flushes"
        self.library = preload("stalled_disk", folder)

    def wrapper(self, end: str, what: str = "FAILED_FLUSH") -> tuple[str, ...]:
        """A wrapper under which a flush of files with this ending fails once after each fail()."""
        return ("env", f"LD_PRELOAD={self.library}", f"{what}={self.failure}", f"FAILED_OF={end}",
                f"FLUSHED={self.flushes}")

    def fail(self) -> None:
        self.failure.touch()

    def flushed(self) -> int:
        return self.flushes.stat().st_size if self.flushes.exists() else 0


@pytest.fixture
def disk(desk: Desk) -> Disk:
    (desk.folder / "rec").mkdir()
    return Disk(desk.folder)


def test_a_failed_flush_of_a_growing_file(desk: Desk, disk: Disk, clip: pathlib.Path) -> None:
    disk.fail()
    saver = start_recorder(desk, "-output", "out.y4m", wrapper=disk.wrapper(".y4m"))
    assert desk.run("ddxvideoload", clip, "-readers", "1").returncode == 0
    status, saved = result(saver)
    assert status == 1 and not disk.failure.exists() and "Input/output error" in desk.errors(saver)
    assert (saved["out"], saved["lost"]["write"]) == (0, saved["in"]) and saved["in"] > 0
    assert not (desk.folder / "out.y4m").exists()


@pytest.mark.parametrize("end", [".y4m", ".index"])
def test_a_failed_flush_of_a_pool_file(desk: Desk, disk: Disk, clip: pathlib.Path, end: str) -> None:
    saver = start_recorder(desk, "-output", "rec", "-segment", "4", wrapper=disk.wrapper(end))
    assert desk.run("ddxvideoload", clip, "-readers", "1").returncode == 0
    wait_until(lambda: desk.out("ddxvideosave") == 20)
    disk.fail()
    assert desk.run("ddxvideoload", clip, "-readers", "1").returncode == 0
    status, saved = result(saver)
    assert status == 1 and not disk.failure.exists() and "Input/output error" in desk.errors(saver)
    assert saved["out"] == 20 and saved["lost"]["write"] == lost(saved) == saved["in"] - 20 > 0
    file, = recordings(desk)
    assert pictures(file) == pictures(clip)
    done = run(desk, "verify")
    assert (done.returncode, done.stdout) == (0, f"{file.name}: good, 20 frames\n")


def test_a_failed_flush_of_a_log(desk: Desk, disk: Disk, compile_client: Compiler) -> None:
    logger = begin(desk, wrapper=disk.wrapper(".mcap"))
    write(desk, compile_client, "first", 20, 1000)
    wait_until(lambda: desk.out("ddxlog") == 20)
    before = disk.flushed()
    wait_until(lambda: disk.flushed() > before)
    disk.fail()
    write(desk, compile_client, "second", 20, 1000)
    status, counters = result(logger)
    assert status == 1 and not disk.failure.exists() and "Input/output error" in desk.errors(logger)
    assert counters["out"] == 20 and counters["lost"]["write"] == lost(counters) == counters["in"] - 20 > 0
    assert desk.run("ddxlog", "-recover", only(desk)).returncode == 0  # it has no end record
    log = logs.read(only(desk))
    assert len(log.values["first"]) == 20 and "second" not in log.values


def test_a_failed_flush_of_an_exported_copy(desk: Desk, disk: Disk, clip: pathlib.Path) -> None:
    """The file's name may not be safe on the stick, so the export fails."""
    saver = start_recorder(desk, "-output", "rec", "-segment", "4")
    assert desk.run("ddxvideoload", clip, "-readers", "1").returncode == 0
    saver.terminate()
    assert result(saver)[0] == 0
    (desk.folder / "to").mkdir()
    disk.fail()
    export = desk.start("ddxrecordings", "export", "all", "to", "-folder", "rec",
                        wrapper=disk.wrapper("/to", "FAILED_FSYNC"))
    assert export.wait(60) == 1 and "not exported: to: Input/output error" in desk.errors(export)
    assert not list((desk.folder / "to").iterdir())
    disk.fail()
    export = desk.start("ddxrecordings", "export", "all", "to", "-folder", "rec",
                        wrapper=disk.wrapper("nothing", "FAILED_FSYNC"))
    assert export.wait(60) == 0
