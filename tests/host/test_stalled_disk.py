# SPDX-License-Identifier: GPL-2.0-or-later
"""The disk hangs: the thread that takes frames continues, and every frame is recorded or counted."""
from __future__ import annotations

import functools
import pathlib
import subprocess

import pytest

from .programs import Desk, Process, lost, make_clip, pictures, start_recorder, stop, wait_for_recorder, wait_until
from .test_record_commands import command, count, reached

pytestmark = pytest.mark.strict


class StalledDisk:
    """A recorder's disk that hangs between stall() and go_on(), for syncs, writes or the first open."""

    def __init__(self, folder: pathlib.Path) -> None:
        source = pathlib.Path(__file__).with_name("stalled_disk.c")
        subprocess.run(["gcc", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC", source, "-o", folder / "stall.so"],
                       check=True)
        self.files = {what: folder / f"stalled-{what}" for what in ("sync", "write", "open")}
        self.wrapper = ("env", f"LD_PRELOAD={folder}/stall.so",
                        *(f"STALLED_{what.upper()}={file}" for what, file in self.files.items()))

    def stall(self, what: str) -> None:
        self.files[what].touch()

    def go_on(self) -> None:
        for file in self.files.values():
            file.unlink(missing_ok=True)


@pytest.fixture
def disk(desk: Desk) -> StalledDisk:
    (desk.folder / "rec").mkdir()
    return StalledDisk(desk.folder)


def start(desk: Desk, disk: StalledDisk, clip: pathlib.Path, *options: object) -> tuple[Process, Process]:
    saver = start_recorder(desk, "-output", "rec", *options, wrapper=disk.wrapper)
    return saver, desk.start("ddxvideoload", clip, "-loop", "-readers", "1")


def is_recording(desk: Desk, saver: Process) -> bool:
    return "recording video" in desk.errors(saver)


def recorded(desk: Desk) -> list[list[bytes]]:
    return [pictures(file) for file in sorted((desk.folder / "rec").glob("*.y4m"))]


def test_frames_are_taken_while_files_wait_to_be_closed(desk: Desk, disk: StalledDisk) -> None:
    """New files are started while three wait for the disk."""
    clip = make_clip(desk.folder / "clip.y4m", frames=100)
    saver, loader = start(desk, disk, clip)
    reached(desk, "in", 5)
    disk.stall("sync")
    for _ in range(3):
        command(desk, "split")
        reached(desk, "in", count(desk, "in") + 2)
    reached(desk, "in", count(desk, "in") + 70)  # more than the store keeps
    assert len(recorded(desk)) == 4
    disk.go_on()
    _, loaded = stop(loader)
    status, saved = stop(saver)
    assert status == 0 and lost(saved) == 0 and saved["in"] == saved["out"] == loaded["out"]
    played = pictures(clip) * 10
    assert [picture for file in recorded(desk) for picture in file] == played[:loaded["out"]]


def test_a_file_that_opens_late_keeps_its_place(desk: Desk, disk: StalledDisk) -> None:
    """Numbers show the order, even if the second recording began before the first had a file."""
    clip = make_clip(desk.folder / "clip.y4m", "64x48", frames=250)
    disk.stall("open")
    saver, loader = start(desk, disk, clip)
    reached(desk, "in", 10)
    command(desk, "stop")
    command(desk, "start")
    reached(desk, "in", count(desk, "in") + 5)
    disk.go_on()
    reached(desk, "out", 15)
    stop(loader)
    status, saved = stop(saver)
    played, (first, second) = pictures(clip), recorded(desk)
    assert status == 0 and lost(saved) == 0 and len(first) + len(second) == saved["in"] == saved["out"]
    assert first == played[:len(first)]
    begin = len(first) + saved["skipped"]
    assert second == played[begin:begin + len(second)]
    assert [int(file.name.split("-")[1]) for file in sorted((desk.folder / "rec").iterdir())] == [1, 2]


def test_frames_beyond_the_ring_are_counted(desk: Desk, disk: StalledDisk) -> None:
    """When memory is full, frames are lost and counted, and the recorder continues when the disk does."""
    clip = make_clip(desk.folder / "clip.y4m", "64x48", frames=1000)
    saver, loader = start(desk, disk, clip, "-ring", "16")
    reached(desk, "in", 5)
    disk.stall("sync")
    for _ in range(10):
        command(desk, "split")
        reached(desk, "in", count(desk, "in"))
    assert "the ring is full" in desk.errors(saver)
    wait_until(lambda: int(desk.stats("ddxvideosave")["lost"]["ring"]) > 3)
    disk.go_on()
    reached(desk, "out", count(desk, "out") + 10)
    _, loaded = stop(loader)
    status, saved = stop(saver)
    assert status == 0 and saved["lost"]["ring"] == lost(saved)
    assert saved["in"] == loaded["out"] == saved["out"] + lost(saved)
    shown = [picture for file in recorded(desk) for picture in file]
    played = iter(pictures(clip))
    assert len(shown) == saved["out"] and all(picture in played for picture in shown)  # in order


@pytest.mark.parametrize("format", ["y4m", "h264"])
def test_a_disk_that_hangs_for_five_seconds(desk: Desk, disk: StalledDisk, format: str) -> None:
    """The usual ring has room for 2.5 s of Y4M, and for these frames in H.264: none is lost."""
    saver = start_recorder(desk, "-output", "rec", "-segment", 32, "-format", format, wrapper=disk.wrapper)
    wait_for_recorder(desk)
    for played, frames in ((5, 5), (130, 125)):
        clip = make_clip(desk.folder / "clip.y4m", frames=frames)
        assert desk.run("ddxvideoload", clip, "-rate", "0", "-readers", "1").returncode == 0
        reached(desk, "in", played - 1)
        if played == 5:
            reached(desk, "out", played - 1)
            disk.stall("write")
    disk.go_on()
    status, saved = stop(saver)
    assert (status, saved["in"]) == (0, 130) and saved["out"] + lost(saved) == 130
    assert lost(saved) == saved["lost"]["ring"] and bool(lost(saved)) == (format == "y4m")


def test_a_new_file_that_another_user_locks_first(desk: Desk, disk: StalledDisk) -> None:
    """Locked between its creation and the recorder's lock: another file is used."""
    clip = make_clip(desk.folder / "clip.y4m", "64x48")
    saver = start_recorder(desk, "-output", "rec", wrapper=(*disk.wrapper, "LOCKED_FIRST=yes"))
    assert desk.run("ddxvideoload", clip, "-readers", "1", "-rate", "8").returncode == 0
    status, saved = stop(saver)
    assert status == 0 and lost(saved) == 0 and recorded(desk) == [pictures(clip)]


def test_two_recorders_are_killed(desk: Desk, disk: StalledDisk) -> None:
    """Only one has frames on the disk; these count for that one, whichever starts first."""
    make_clip(desk.folder / "clip.y4m", "64x48", frames=250)
    wanted = ("-output", "rec", "-segment", 4, "-instance")
    disk.stall("sync")
    savers = [start_recorder(desk, *wanted, "one"), start_recorder(desk, *wanted, "two", wrapper=disk.wrapper)]
    desk.start("ddxvideoload", "clip.y4m", "-loop", "-readers", "2", "-rate", "3")
    wait_until(lambda: desk.out("one") > 10 and int(desk.stats("two")["in"]) > 10)
    for saver in savers:
        saver.kill()
        saver.wait()
    assert desk.out("two") == 0
    files = 1  # of the first recorder
    for name in "two", "one":
        saver = start_recorder(desk, *wanted, name)
        wait_until(functools.partial(is_recording, desk, saver))
        status, saved = stop(saver)
        found = recorded(desk)
        mine = found[files:] if name == "two" else found[:1] + found[files:]
        assert status == 0 and saved["out"] == sum(map(len, mine)) and saved["in"] == saved["out"] + lost(saved)
        files = len(found)
