# SPDX-License-Identifier: GPL-2.0-or-later
"""Damaged clips, full disks, killed programs: recordings stay readable, and every frame is counted."""
from __future__ import annotations

import json
import os
import pathlib
import re
import signal
import subprocess
import time

import pytest

from .programs import (Compiler, Counters, Desk, Process, frame_md5, header_of, lost, make_clip, pictures, record,
                       result, start_recorder, stop, times, wait_until)

pytestmark = pytest.mark.strict

PICTURE = 64 * 48 * 3 // 2


@pytest.fixture
def clip(desk: Desk) -> pathlib.Path:
    return make_clip(desk.folder / "clip.y4m", "64x48", "100", 20)


def recording_begun(path: pathlib.Path, frames: int = 3) -> bool:
    return path.exists() and path.stat().st_size > frames * PICTURE


# ---- Clips ----

@pytest.mark.parametrize("cut", [1, PICTURE // 2, PICTURE, PICTURE + 3])
def test_clip_cut_short(desk: Desk, clip: pathlib.Path, cut: int) -> None:
    """Its whole frames are played, then the truncation is reported."""
    clip.write_bytes(clip.read_bytes()[:-cut])
    saver = start_recorder(desk, "-output", "out.y4m")
    loader = desk.run("ddxvideoload", clip, "-readers", "1")
    assert loader.returncode == 0
    assert re.fullmatch(rf"ddxvideoload: {clip}: .*cut short.*\n", loader.stderr)
    assert stop(saver)[1]["out"] == 19
    assert pictures(desk.folder / "out.y4m") == pictures(clip)


def test_clip_damaged_in_the_middle(desk: Desk, clip: pathlib.Path) -> None:
    data = bytearray(clip.read_bytes())
    at = data.index(b"FRAME", len(data) // 2)
    data[at:at + 5] = b"FRAMX"
    clip.write_bytes(data)
    loader = desk.run("ddxvideoload", clip)
    assert loader.returncode == 2 and "damaged" in loader.stderr and loader.stderr.count("\n") == 1


def test_clip_without_frames(desk: Desk, clip: pathlib.Path) -> None:
    clip.write_bytes(clip.read_bytes().split(b"FRAME")[0])
    loader = desk.run("ddxvideoload", clip, "-loop")
    assert loader.returncode == 2 and "no frame" in loader.stderr


# ---- Disks ----

def check_stopped_by_disk(desk: Desk, saver: Process, recorded: pathlib.Path, clip: pathlib.Path) -> Counters:
    status, counters = result(saver)
    errors = desk.errors(saver)
    assert status == 1 and "recording stopped" in errors
    assert counters["in"] == counters["out"] + lost(counters) and counters["waiting"] == 0
    assert counters["lost"]["write"] > 0
    frames = pictures(recorded)
    assert len(frames) == counters["out"] > 0
    assert frames == (pictures(clip) * 20)[:len(frames)]
    assert recorded.read_bytes().endswith(frames[-1])  # nothing after the last whole frame
    assert len(frame_md5(recorded)) == len(frames)
    assert desk.run("ddxvideoload", recorded, "-rate", "0").returncode == 0
    return counters


def test_file_too_large(desk: Desk, clip: pathlib.Path) -> None:
    limit = 10 * PICTURE + 1000
    saver = start_recorder(desk, "-output", "out.y4m", wrapper=("prlimit", f"--fsize={limit}"))
    desk.run("ddxvideoload", clip, "-readers", "1")
    check_stopped_by_disk(desk, saver, desk.folder / "out.y4m", clip)


@pytest.mark.parametrize("output", ["out.y4m", ""])
def test_disk_full(desk: Desk, clip: pathlib.Path, small_disk: pathlib.Path, output: str) -> None:
    saver = start_recorder(desk, "-output", small_disk / output if output else small_disk)
    desk.run("ddxvideoload", clip, "-readers", "1")
    check_stopped_by_disk(desk, saver, next(small_disk.glob("*.y4m")), clip)
    assert "No space left" in desk.errors(saver)


def test_file_that_opens_late(desk: Desk) -> None:
    """The thread that takes frames does not wait for the disk, not even for the first file's name."""
    clip, pipe = make_clip(desk.folder / "clip.y4m", "64x48", "50", 100), desk.folder / "pipe"
    os.mkfifo(pipe)
    saver = start_recorder(desk, "-output", pipe)
    loader = desk.run("ddxvideoload", clip, "-readers", "1")
    assert loader.returncode == 0 and not saver.poll()
    recorded = desk.folder / "out.y4m"
    with recorded.open("wb") as file, subprocess.Popen(["timeout", "60", "cat", pipe], stdout=file):  # it opens now
        status, counters = stop(saver)
    assert status == 0 and lost(counters) == 0 and counters["out"] == 100
    assert pictures(recorded) == pictures(clip)


def test_disk_full_from_the_start(desk: Desk, clip: pathlib.Path, small_disk: pathlib.Path) -> None:
    (small_disk / "filler").write_bytes(bytes(64 * 1024))
    saver = start_recorder(desk, "-output", small_disk / "out.y4m")
    desk.run("ddxvideoload", clip, "-readers", "1")
    status, counters = result(saver)
    assert status == 1 and counters["out"] == 0 and counters["in"] == lost(counters)
    assert not (small_disk / "out.y4m").exists()


def test_slow_disk(desk: Desk, clip: pathlib.Path) -> None:
    """A pipe without a reader: frames are lost in the ring and counted, and the rest is in order."""
    pipe = desk.folder / "pipe"
    os.mkfifo(pipe)
    saver = start_recorder(desk, "-output", pipe, "-ring", "4")
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    try:
        desk.run("ddxvideoload", clip, "-readers", "1")
        wait_until(lambda: int(desk.stats("ddxvideosave")["in"]) == 20)
        os.set_blocking(reader, True)
        saver.terminate()
        data = b""
        while part := os.read(reader, 1 << 20):
            data += part
    finally:
        os.close(reader)
    status, counters = result(saver)
    (desk.folder / "out.y4m").write_bytes(data)
    frames, played = pictures(desk.folder / "out.y4m"), pictures(clip)
    assert status == 0 and "ring is full" in desk.errors(saver)
    assert counters["in"] == 20 == counters["out"] + counters["lost"]["ring"]
    assert len(frames) == counters["out"] and 0 < counters["lost"]["ring"] < 20
    assert [played.index(frame) for frame in frames] == sorted(played.index(frame) for frame in frames)


# ---- Signals and exits ----

def record_loop(desk: Desk, clip: pathlib.Path) -> tuple[Process, Process]:
    saver = start_recorder(desk, "-output", "out.y4m")
    loader = desk.start("ddxvideoload", clip, "-loop", "-readers", "1")
    wait_until(lambda: recording_begun(desk.folder / "out.y4m"))
    return saver, loader


def test_report_on_request(desk: Desk, clip: pathlib.Path) -> None:
    saver, loader = record_loop(desk, clip)
    for process in (loader, saver):
        process.send_signal(signal.SIGUSR1)
        assert process.stdout
        line = process.stdout.readline()
        assert re.fullmatch(r'\{"instance":"ddxvideo(load|save)","in":\d+,"out":\d+,"waiting":\d+,"skipped":0,'
                            r'"lost":\{[^}]*\},'
                            r'"latency_us":\{"p50":\d+,"p99":\d+,"max":\d+\},"latency_until":"out",'
                            r'"starts":1,"first_ns":\d+,"last_ns":\d+\}\n', line)
    _, loaded = stop(loader)
    status, saved = stop(saver)
    assert status == 0 and saved["in"] == saved["out"] == loaded["out"]


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_stop_while_waiting(desk: Desk, clip: pathlib.Path, number: signal.Signals) -> None:
    waiting = [start_recorder(desk, "-output", "out.y4m"), desk.start("ddxvideoload", clip, "-readers", "3")]
    wait_until(lambda: desk.run("ddxctl", "stats").stdout.count("ddxvideo") == 2)
    for process in waiting:
        begin = time.monotonic()
        status, counters = stop(process, number)
        assert status == 0 and counters["in"] == 0
        assert time.monotonic() - begin < 5  # after 5 s a service is killed
    assert not (desk.folder / "out.y4m").exists()


def test_stop_without_store(desk: Desk, clip: pathlib.Path) -> None:
    stop(desk.store)
    waiting = [start_recorder(desk, "-output", "out.y4m"), desk.start("ddxvideoload", clip)]
    wait_until(lambda: all("waiting" in desk.errors(process) for process in waiting))
    for process in waiting:
        assert stop(process)[0] == 0


def test_killed_recorder(desk: Desk, clip: pathlib.Path) -> None:
    """The file ends with the last whole frame, and the next recorder continues its counters."""
    first, second = desk.folder / "first.y4m", desk.folder / "second.y4m"
    loader = desk.start("ddxvideoload", clip, "-loop", "-readers", "1")
    saver = start_recorder(desk, "-output", first)
    wait_until(lambda: recording_begun(first, 10))
    saver.kill()
    saver.wait()
    recorded = len(pictures(first))
    assert recorded >= 10 and len(frame_md5(first)) == recorded
    replay = desk.run("ddxvideoload", first, "-rate", "0", "-name", "replay", "-instance", "replay")
    assert desk.stats("replay")["out"] == recorded and replay.returncode in (0, 2)

    begin = desk.out("ddxvideoload")
    wait_until(lambda: desk.out("ddxvideoload") >= begin + 10)
    saver = start_recorder(desk, "-output", second)
    wait_until(lambda: recording_begun(second))
    _, loaded = stop(loader)
    status, saved = stop(saver)
    assert status == 0 and saved["starts"] == 2
    assert saved["in"] == loaded["out"] == saved["out"] + lost(saved)
    assert saved["out"] == recorded + len(pictures(second))
    assert saved["lost"]["restart"] > 5 and "no recorder ran" in desk.errors(saver)


def test_recorder_held_up(desk: Desk, clip: pathlib.Path) -> None:
    """A frozen recorder misses frames; it reports their numbers, and the counters add up."""
    saver = desk.start("ddxvideosave", "-output", "out.y4m")
    loader = desk.start("ddxvideoload", clip, "-loop", "-readers", "1")
    wait_until(lambda: recording_begun(desk.folder / "out.y4m"))
    saver.send_signal(signal.SIGSTOP)
    begin = desk.out("ddxvideoload")
    wait_until(lambda: desk.out("ddxvideoload") >= begin + 60)
    saver.send_signal(signal.SIGCONT)
    reached = desk.out("ddxvideoload")
    wait_until(lambda: int(desk.stats("ddxvideosave")["in"]) > reached)
    _, loaded = stop(loader)
    status, saved = stop(saver)
    missed = saved["lost"]["store"]
    assert status == 0 and missed > 10
    assert saved["in"] == loaded["out"] == saved["out"] + missed
    said = re.findall(r"lost frames? (\d+)(?: to (\d+))?:", desk.errors(saver))
    numbers = {n for first, last in said for n in range(int(first), int(last or first) + 1)}
    assert len(numbers) == missed
    kept = [n for n in range(loaded["out"]) if n not in numbers]
    played = pictures(clip)
    assert pictures(desk.folder / "out.y4m") == [played[n % 20] for n in kept]
    assert times(desk.folder / "out.y4m") == [n * 10_000_000 for n in kept]


def test_a_recorder_that_waits_misses_no_first_frame(desk: Desk) -> None:
    """The recorder is frozen while the first frames are written, all within 60 ms."""
    clip = make_clip(desk.folder / "clip.y4m", frames=7)
    saver = desk.start("ddxvideosave", "-output", "out.y4m")
    wait_until(lambda: "waiting for video" in desk.errors(saver))
    saver.send_signal(signal.SIGSTOP)
    assert desk.start("ddxvideoload", clip).wait(60) == 0
    saver.send_signal(signal.SIGCONT)
    wait_until(lambda: int(desk.stats("ddxvideosave")["out"]) == 7)
    status, saved = stop(saver)
    assert status == 0 and saved["in"] == saved["out"] == 7 and lost(saved) == 0
    assert pictures(desk.folder / "out.y4m") == pictures(clip)


def test_frames_before_the_item_was_found_are_counted(desk: Desk, clip: pathlib.Path) -> None:
    """The recorder started first, but was frozen before it noticed the new writer."""
    saver = desk.start("ddxvideosave", "-output", "out.y4m")
    wait_until(lambda: "waiting for video" in desk.errors(saver))
    saver.send_signal(signal.SIGSTOP)
    loader = desk.start("ddxvideoload", clip, "-loop")
    wait_until(lambda: "ddxvideoload" in desk.run("ddxctl", "stats").stdout)
    wait_until(lambda: int(desk.stats("ddxvideoload")["out"]) > 30)
    saver.send_signal(signal.SIGCONT)
    wait_until(lambda: recording_begun(desk.folder / "out.y4m"))
    _, loaded = stop(loader)
    status, saved = stop(saver)
    missed = saved["lost"]["store"]
    assert status == 0 and missed > 20
    assert saved["in"] == loaded["out"] == saved["out"] + missed
    # Reported at once if the recorder runs then.
    said = re.findall(r"lost frames? (\d+)(?: to (\d+))?:", desk.errors(saver))
    first, last = said[0]
    assert int(first) == 0 and int(last) > 20
    assert sum(int(last or first) - int(first) + 1 for first, last in said) == missed
    found = times(desk.folder / "out.y4m")
    assert len(found) == saved["out"] and found[-1] // 10_000_000 + 2 + int(last) == loaded["out"]


def test_a_pause_within_the_kept_frames_loses_nothing(desk: Desk) -> None:
    """A pause of most of the kept frames; the rate is low, so that other delays do not add up."""
    clip = make_clip(desk.folder / "clip.y4m")
    saver = desk.start("ddxvideosave", "-output", "out.y4m")
    loader = desk.start("ddxvideoload", clip, "-loop", "-readers", "1", "-rate", "0.4")
    wait_until(lambda: recording_begun(desk.folder / "out.y4m"))
    saver.send_signal(signal.SIGSTOP)
    begin = int(desk.stats("ddxvideoload")["out"])
    wait_until(lambda: int(desk.stats("ddxvideoload")["out"]) >= begin + 18)
    saver.send_signal(signal.SIGCONT)
    _, loaded = stop(loader)
    status, saved = stop(saver)
    assert status == 0 and lost(saved) == 0 and saved["in"] == saved["out"] == loaded["out"]


def test_the_store_keeps_as_many_frames_as_requested(desk: Desk, clip: pathlib.Path) -> None:
    saver = desk.start("ddxvideosave", "-output", "out.y4m", "-keep", "64")
    loader = desk.start("ddxvideoload", clip, "-loop", "-readers", "1", "-rate", "0.5")
    wait_until(lambda: recording_begun(desk.folder / "out.y4m"))
    saver.send_signal(signal.SIGSTOP)
    begin = desk.out("ddxvideoload")
    wait_until(lambda: desk.out("ddxvideoload") >= begin + 35)  # without -keep the store keeps 25
    saver.send_signal(signal.SIGCONT)
    _, loaded = stop(loader)
    status, saved = stop(saver)
    assert status == 0 and lost(saved) == 0 and saved["in"] == saved["out"] == loaded["out"]


def test_a_small_store_keeps_fewer_frames_for_the_recorder(tmp_path: pathlib.Path) -> None:
    desk = Desk(tmp_path, "3M")
    try:
        clip = make_clip(desk.folder / "clip.y4m")
        saver = desk.start("ddxvideosave", "-output", "out.y4m")
        assert desk.run("ddxvideoload", clip, "-readers", "1").returncode == 0
        assert stop(saver)[1]["out"] == 25 and pictures(desk.folder / "out.y4m") == pictures(clip)
        assert "it keeps 4 frames for the recorder" in desk.errors(desk.processes[1])
    finally:
        desk.end()


def test_killed_loader(desk: Desk, clip: pathlib.Path) -> None:
    """The recorder waits for the next writer of the item and goes on in the same file."""
    saver, loader = record_loop(desk, clip)
    loader.kill()
    loader.wait()
    again = desk.run("ddxvideoload", clip, "-readers", "1")
    status, saved = stop(saver)
    loaded = json.loads(again.stdout)
    assert again.returncode == 0 == status and loaded["starts"] == 2
    assert saved["in"] == saved["out"] and lost(saved) == 0
    assert loaded["in"] == loaded["out"] + lost(loaded)
    frames = pictures(desk.folder / "out.y4m")
    assert len(frames) == saved["out"] and frames[-20:] == pictures(clip)


def test_store_restarted(desk: Desk, clip: pathlib.Path) -> None:
    """The frame path does not need the store, which may restart during a recording."""
    saver, loader = record_loop(desk, clip)
    desk.store.kill()
    desk.store.wait()
    wait_until(lambda: recording_begun(desk.folder / "out.y4m", 30))
    desk.store = desk.start("ddxstore", "-m", "64M")
    wait_until(lambda: min(desk.out("ddxvideosave"), desk.out("ddxvideoload")) > 60)
    _, loaded = stop(loader)
    status, saved = stop(saver)
    assert status == 0 and lost(saved) == 0
    assert saved["in"] == saved["out"] == loaded["out"] > 60
    assert desk.stats("ddxvideosave")["out"] == saved["out"]


def test_broken_writer(desk: Desk, compile_client: Compiler) -> None:
    """Frames with impossible sizes are counted as lost; the others are recorded."""
    saver = start_recorder(desk, "-output", "out.y4m")
    assert desk.run(compile_client("item_client", "ddxvideo"), "broken_grabber").returncode == 0
    status, saved = stop(saver)
    assert status == 0
    assert (saved["in"], saved["out"], saved["lost"]["store"]) == (20, 15, 5)
    assert desk.errors(saver).count("do not fit its memory") == 5
    assert len(pictures(desk.folder / "out.y4m")) == 15


def test_clean_restart_loses_nothing(desk: Desk, clip: pathlib.Path) -> None:
    """Frames between a requested stop and a start are no loss."""
    first, second = desk.folder / "first.y4m", desk.folder / "second.y4m"
    _, one = record(desk, clip, first)
    _, two = record(desk, clip, second)
    assert (two["starts"], two["in"], two["out"], lost(two)) == (2, 40, 40, 0)
    assert one["first_ns"] == two["first_ns"] < two["last_ns"]
    assert pictures(first) == pictures(second) == pictures(clip)


def test_one_program_per_instance(desk: Desk, clip: pathlib.Path) -> None:
    saver = start_recorder(desk, "-output", "out.y4m")
    wait_until(lambda: "ddxvideosave.stats" in desk.run("ddxctl", "list").stdout)
    other = desk.run("ddxvideosave", "-output", "other.y4m")
    assert other.returncode == 1 and "-instance" in other.stderr and other.stderr.count("\n") == 1
    assert stop(saver)[0] == 0


def test_one_writer_per_item(desk: Desk, clip: pathlib.Path) -> None:
    loader = desk.start("ddxvideoload", clip, "-loop")
    wait_until(lambda: "video.frame" in desk.run("ddxctl", "list").stdout)
    other = desk.run("ddxvideoload", clip, "-instance", "other")
    assert other.returncode == 1 and other.stderr.startswith("ddxvideoload: video: ")
    assert stop(loader)[0] == 0


def test_no_room_in_the_store(tmp_path: pathlib.Path) -> None:
    desk = Desk(tmp_path, memory="1M")
    try:
        loader = desk.run("ddxvideoload", make_clip(tmp_path / "clip.y4m", "1280x720", frames=2))
        assert loader.returncode == 1 and "ddxvideoload: video: " in loader.stderr
    finally:
        desk.end()


# ---- Change of picture size ----

def test_change_of_size_in_a_file(desk: Desk, clip: pathlib.Path) -> None:
    other = make_clip(desk.folder / "other.y4m", "32x32", "100", 20)
    saver = start_recorder(desk, "-output", "out.y4m")
    desk.run("ddxvideoload", clip, "-readers", "1")
    desk.run("ddxvideoload", other, "-instance", "other")
    status, counters = result(saver)
    assert status == 1 and "changed from 64x48 to 32x32" in desk.errors(saver)
    assert counters["out"] == 20 and counters["in"] == 20 + counters["lost"]["write"] > 20
    assert pictures(desk.folder / "out.y4m") == pictures(clip)


def test_change_of_size_in_a_folder(desk: Desk, clip: pathlib.Path) -> None:
    other = make_clip(desk.folder / "other.y4m", "128x96", "100", 20)
    folder = desk.folder / "recordings"
    folder.mkdir()
    (folder / "video-000041-20200101T000000Z.y4m").write_text("not to be touched")
    saver = start_recorder(desk, "-output", folder)
    for number, played in enumerate((clip, other, clip)):
        assert desk.run("ddxvideoload", played, "-readers", "1", "-instance", f"load{number}").returncode == 0
    status, counters = stop(saver)
    assert status == 0 and (counters["in"], counters["out"]) == (60, 60)
    names = sorted(path.name for path in folder.iterdir())
    assert [re.sub(r"-\d{8}T\d{6}Z", "", name) for name in names] == [f"video-0000{n}.y4m" for n in (41, 42, 43, 44)]
    for name, played in zip(names[1:], (clip, other, clip)):
        assert pictures(folder / name) == pictures(played)
        assert header_of(folder / name) == header_of(played).replace(" XYSCSS=420JPEG", "")
