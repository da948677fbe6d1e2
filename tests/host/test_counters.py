# SPDX-License-Identifier: GPL-2.0-or-later
"""Every written frame is in a file, or is counted with the reason for its loss."""
from __future__ import annotations

import json
import os
import pathlib
import shutil
import signal
import subprocess

import pytest

from parts.common import MORTAL

from .programs import (ROOT, Counters, Desk, Process, lost, make_clip, pictures, preload, result, start_recorder,
                       stop, wait_until)

pytestmark = pytest.mark.strict

PICTURE = 64 * 48 * 3 // 2


@pytest.fixture
def clip(desk: Desk) -> pathlib.Path:
    return make_clip(desk.folder / "clip.y4m", "64x48", "100", 50)


def attached(desk: Desk) -> bool:
    """Whether the recorder accounts for frames from now on, and the store knows it."""
    stats = desk.run("ddxctl", "show", "ddxvideosave.stats", "--json").stdout
    return bool(desk.readers("video")) and '"running":1' in stats and '"follows":0' not in stats


def idle_loader(desk: Desk, clip: pathlib.Path) -> Process:
    """A loader with an item that writes nothing before there are two readers."""
    loader = desk.start("ddxvideoload", clip, "-readers", "2", "-instance", "load")
    wait_until(lambda: "video " in desk.run("ddxctl", "list").stdout)
    return loader


def second_reader(desk: Desk) -> Process:
    return desk.start("ddxvideosave", "-output", "/dev/null", "-keep", "1", "-instance", "second")


def balanced(counters: Counters) -> bool:
    return bool(counters["in"] == counters["out"] + lost(counters) and not counters["waiting"])


def recorded(*files: pathlib.Path) -> int:
    return sum(len(pictures(file)) for file in files)


def test_stopped_while_attached(desk: Desk, clip: pathlib.Path) -> None:
    """Frames written before its first read are counted as lost."""
    loader = idle_loader(desk, clip)
    saver = desk.start("ddxvideosave", "-output", "out.y4m", "-keep", "8")
    wait_until(lambda: attached(desk))
    saver.send_signal(signal.SIGSTOP)
    other = second_reader(desk)
    _, loaded = result(loader)
    saver.send_signal(signal.SIGCONT)
    wait_until(lambda: int(desk.stats("ddxvideosave")["in"]) >= 50)
    _, saved = stop(saver)
    stop(other)
    assert loaded["out"] == saved["in"] == 50 and balanced(saved) and saved["lost"]["store"] >= 30
    assert recorded(desk.folder / "out.y4m") == saved["out"]


def test_killed_while_attached(desk: Desk, clip: pathlib.Path) -> None:
    """Killed before its first frame: frames written until the next recorder starts are counted as lost."""
    loader = idle_loader(desk, clip)
    saver = start_recorder(desk, "-output", "out.y4m")
    wait_until(lambda: attached(desk))
    saver.send_signal(signal.SIGSTOP)
    other = second_reader(desk)
    _, loaded = result(loader)
    saver.kill()
    saver.wait()
    saver = start_recorder(desk, "-output", "out.y4m")
    wait_until(lambda: int(desk.stats("ddxvideosave")["starts"]) == 2)
    wait_until(lambda: int(desk.stats("ddxvideosave")["in"]) == 50)
    status, saved = stop(saver)
    stop(other)
    assert status == 0 and loaded["out"] == saved["in"] == saved["lost"]["restart"] == 50 and balanced(saved)


def test_stopped_on_request_and_the_next_recorder_killed(desk: Desk, clip: pathlib.Path) -> None:
    """Frames after a requested stop are not lost, even if the next recorder dies before it sees any."""
    assert stop(started(desk, clip))[0] == 0
    assert desk.run("ddxvideoload", clip, "-rate", "0").returncode == 0
    saver = start_recorder(desk, "-output", "out.y4m")
    wait_until(lambda: attached(desk))
    saver.kill()
    saver.wait()
    saver = start_recorder(desk, "-output", "third.y4m")
    assert desk.run("ddxvideoload", clip, "-readers", "1").returncode == 0
    status, saved = stop(saver)
    assert status == 0 and saved["in"] == saved["out"] == 100 and lost(saved) == 0


def started(desk: Desk, clip: pathlib.Path, *options: object) -> Process:
    """A recorder that has recorded the whole clip."""
    saver = start_recorder(desk, "-output", "out.y4m", *options)
    assert desk.run("ddxvideoload", clip, "-readers", "1").returncode == 0
    wait_until(lambda: int(desk.stats("ddxvideosave")["out"]) == 50)
    return saver


def test_counters_are_kept_longer_than_pictures(tmp_path: pathlib.Path) -> None:
    """When memory is needed, the store drops pictures that no program has open, but keeps a dead program's losses."""
    desk = Desk(tmp_path, "2M")
    try:
        clip = make_clip(tmp_path / "clip.y4m", "64x48", "100", 50)
        saver = started(desk, clip)
        saver.kill()
        saver.wait()
        for name in "abcde":
            big = make_clip(tmp_path / "big.y4m", "320x240", "100", 2)
            assert desk.run("ddxvideoload", big, "-rate", "0", "-name", name, "-instance", "big").returncode == 0
        assert "a.frame" not in (names := {item["name"] for item in json.loads(
            desk.run("ddxctl", "list", "--json").stdout)["items"]})
        assert {"ddxvideosave.stats", "ddxvideoload.stats", "big.stats"} <= names
        assert desk.stats("ddxvideosave")["in"] == 50
    finally:
        desk.end()


# ---- Recorders that give up ----

def test_repeated_stops_by_a_full_disk(desk: Desk, clip: pathlib.Path, small_disk: pathlib.Path) -> None:
    """Frames in each gap between recorders that a full disk stopped are counted."""
    loader = desk.start("ddxvideoload", clip, "-loop", "-readers", "1")
    for number in range(3):
        saver = start_recorder(desk, "-output", small_disk)
        status, saved = result(saver)
        assert status == 1 and balanced(saved) and saved["lost"]["write"] > 0
        written = desk.sequence("video")
        wait_until(lambda: desk.sequence("video") > written + 20)
    files = list(small_disk.glob("*.y4m"))
    _, loaded = stop(loader)
    kept = recorded(*files)
    for file in files:
        file.unlink()
    saver = start_recorder(desk, "-output", small_disk)
    wait_until(lambda: int(desk.stats("ddxvideosave")["starts"]) == 4 and attached(desk))
    wait_until(lambda: bool(desk.stats("ddxvideosave")["in"] == loaded["out"]))
    status, saved = stop(saver)
    assert status == 0 and saved["in"] == loaded["out"] and saved["out"] == kept and balanced(saved)
    assert saved["lost"]["restart"] >= 60


def test_change_of_size_into_one_file(desk: Desk, clip: pathlib.Path) -> None:
    """Frames after the change are counted as lost, by the recorder or by the next one."""
    saver = started(desk, clip)
    other = make_clip(desk.folder / "other.y4m", "32x32", "100", 20)
    assert desk.run("ddxvideoload", other, "-instance", "other").returncode == 0
    status, saved = result(saver)
    assert status == 1 and saved["out"] == 50 and balanced(saved) and saved["lost"]["write"] >= 1
    saver = start_recorder(desk, "-output", "second.y4m")
    wait_until(lambda: attached(desk) and int(desk.stats("ddxvideosave")["in"]) == 70)
    status, saved = stop(saver)
    assert status == 0 and balanced(saved) and saved["lost"]["write"] + saved["lost"]["restart"] == 20


# ---- Writers that die ----

@pytest.fixture(scope="module")
def last_act(tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    """A preloaded library that kills the program right before or after a call."""
    return preload("last_act", tmp_path_factory.mktemp("act"))


@pytest.mark.parametrize("moment, out", [("before", 11), ("after", 12)])
def test_writer_killed_while_it_publishes(desk: Desk, clip: pathlib.Path, last_act: pathlib.Path, moment: str,
                                          out: int) -> None:
    """Whether the frame is in the item or not, the next writer counts accordingly."""
    wrapper = ("env", f"LD_PRELOAD={last_act}", f"LAST_ACT={moment}", "LAST_CALL=12")
    loader = desk.start("ddxvideoload", clip, "-rate", "0", wrapper=wrapper)
    assert loader.wait(60) == -signal.SIGKILL and desk.sequence("video") == out
    again = desk.run("ddxvideoload", clip, "-rate", "0")
    loaded = json.loads(again.stdout.splitlines()[-1])
    assert loaded["out"] == out + 50 == desk.sequence("video") and balanced(loaded)
    assert loaded["in"] == 62 and loaded["lost"]["restart"] == 12 - out


# ---- What is in the file ----

def test_frames_that_the_disk_did_not_save_are_lost(desk: Desk, clip: pathlib.Path) -> None:
    """Frames that were not synced are cut off the file and counted as lost."""
    failed = desk.folder / "failed"
    saver = start_recorder(desk, "-output", "out.y4m", wrapper=(
        "env", f"LD_PRELOAD={preload('stalled_disk', desk.folder)}", f"FAILED_SYNC={failed}"))
    loader = desk.start("ddxvideoload", clip, "-loop", "-readers", "1")
    wait_until(lambda: desk.out("ddxvideosave") > 150)  # some are synced by now
    failed.touch()
    status, saved = result(saver)
    stop(loader)
    assert status == 1 and balanced(saved) and saved["lost"]["write"] > 0
    file = desk.folder / "out.y4m"
    kept = pictures(file)
    assert len(kept) == saved["out"] > 0 and file.read_bytes().endswith(kept[-1])


@pytest.mark.parametrize("target", ["rec/out.y4m", "rec"])
def test_folder_removed(desk: Desk, clip: pathlib.Path, target: str) -> None:
    """The removal is reported, and no missing frame counts as recorded."""
    (desk.folder / "rec").mkdir()
    saver = start_recorder(desk, "-output", target)
    loader = desk.start("ddxvideoload", clip, "-loop", "-readers", "1")
    wait_until(lambda: desk.out("ddxvideosave") > 5)
    shutil.rmtree(desk.folder / "rec")
    status, saved = result(saver)
    stop(loader)
    assert status == 1 and "was removed" in desk.errors(saver)
    assert balanced(saved) and saved["out"] == 0 < saved["lost"]["write"]


def test_two_recorders_and_one_file(desk: Desk, clip: pathlib.Path) -> None:
    """The second recorder is refused, and the first one's file stays intact."""
    first = start_recorder(desk, "-output", "out.y4m")
    # 25 frames a second: the 64 frames that the store keeps last 2.5 s, for a recorder that waits for a processor.
    loader = desk.start("ddxvideoload", clip, "-loop", "-readers", "1", "-rate", "0.25")
    wait_until(lambda: desk.out("ddxvideosave") > 5)
    second = start_recorder(desk, "-output", "out.y4m", "-instance", "second")
    status, refused = result(second)
    assert status == 1 and "another program records into it" in desk.errors(second) and refused["out"] == 0
    _, loaded = stop(loader)
    status, saved = stop(first)
    assert status == 0 and saved["lost"] == dict.fromkeys(saved["lost"], 0)
    assert recorded(desk.folder / "out.y4m") == saved["out"] == loaded["out"]


def test_after_a_crash_nothing_is_overwritten(desk: Desk, clip: pathlib.Path, last_act: pathlib.Path) -> None:
    """The old file is kept and truncated after its last whole frame; the new file gets another name."""
    out = desk.folder / "out.y4m"
    saver = start_recorder(desk, "-output", "out.y4m", wrapper=("env", f"LD_PRELOAD={last_act}", "LAST_ACT=written",
                                                                "LAST_CALL=20"))
    loader = desk.start("ddxvideoload", clip, "-loop", "-readers", "1")
    assert saver.wait(60) == -signal.SIGKILL
    whole = recorded(out)
    assert whole >= 20
    out.write_bytes(out.read_bytes() + b"FRAME XTIME=190000000\n" + bytes(1000))
    replay = desk.run("ddxvideoload", out, "-rate", "0", "-name", "replay", "-instance", "replay")
    assert replay.returncode == 0 and "cut short" in replay.stderr and desk.stats("replay")["out"] == whole
    saver = start_recorder(desk, "-output", "out.y4m")
    second = desk.folder / "out-2.y4m"
    wait_until(second.exists)
    _, loaded = stop(loader)
    status, saved = stop(saver)
    assert status == 0 and recorded(out) == whole and out.read_bytes().endswith(pictures(out)[-1])
    assert "cut after its last whole one" in desk.errors(saver)
    assert saved["out"] == whole + recorded(second) and saved["in"] == loaded["out"] and balanced(saved)


def test_frames_that_only_the_index_has(desk: Desk, clip: pathlib.Path, last_act: pathlib.Path) -> None:
    """After a kill between index and counters, the next recorder finds the frames on the disk."""
    folder = desk.folder / "rec"
    folder.mkdir()
    saver = start_recorder(desk, "-output", folder, "-segment", "4", wrapper=(
        "env", f"LD_PRELOAD={last_act}", "LAST_ACT=written", "LAST_CALL=5"))
    loader = desk.start("ddxvideoload", clip, "-loop", "-readers", "1")
    assert saver.wait(60) == -signal.SIGKILL
    saver = start_recorder(desk, "-output", folder, "-segment", "4")
    wait_until(lambda: desk.out("ddxvideosave") > 60)
    _, loaded = stop(loader)
    status, saved = stop(saver)
    assert status == 0 and saved["out"] == recorded(*folder.glob("*.y4m"))
    assert saved["in"] == loaded["out"] and balanced(saved)


def test_nothing_but_the_clip_on_standard_output(desk: Desk, clip: pathlib.Path) -> None:
    with (desk.folder / "out.y4m").open("wb") as out, (desk.folder / "messages").open("w+") as messages:
        saver = subprocess.Popen([*MORTAL, ROOT / "bin/ddxvideosave", "-output", "-"], env=desk.environment,
                                 cwd=desk.folder, stdout=subprocess.PIPE, stderr=messages)
        cat = subprocess.Popen(["cat"], stdin=saver.stdout, stdout=out)
        source = subprocess.run([*MORTAL, ROOT / "bin/ddxvideoload", "-", "-readers", "1", "-rate", "0.2"],
                                env=desk.environment, cwd=desk.folder, input=clip.read_bytes(), capture_output=True,
                                timeout=60)  # slow: the store keeps 25 frames at most, 8 at first
        saver.terminate()
        assert source.returncode == saver.wait(60) == cat.wait(60) == 0
        messages.seek(0)
        saved = json.loads(messages.read().splitlines()[-1])
    assert (saved["in"], saved["out"], lost(saved)) == (50, 50, 0), saved
    assert pictures(desk.folder / "out.y4m") == pictures(clip) and not (desk.folder / "-").exists()


def test_standard_descriptors_closed(desk: Desk, clip: pathlib.Path) -> None:
    """Messages do not end up in a frame or in the socket to the store."""
    closed = ("sh", "-c", 'exec "$0" "$@" <&- >&- 2>&-')
    saver = start_recorder(desk, "-output", "out.y4m", wrapper=closed)
    loader = desk.start("ddxvideoload", clip, "-readers", "1", wrapper=closed)
    assert loader.wait(60) == 0
    saver.terminate()
    assert saver.wait(60) == 0
    saved = desk.stats("ddxvideosave")
    assert saved["in"] == saved["out"] == 50 and lost(saved) == 0
    assert pictures(desk.folder / "out.y4m") == pictures(clip)


# ---- TERM stops a program that waits ----

@pytest.mark.parametrize("opened", [False, True])
def test_pipe_without_reader(desk: Desk, opened: bool) -> None:
    """Exit status 0, since the stop was requested; frames that were not read are counted as lost."""
    clip, pipe = make_clip(desk.folder / "clip.y4m", "320x240", "100", 20), desk.folder / "pipe"
    os.mkfifo(pipe)
    saver = start_recorder(desk, "-output", pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK) if opened else None
    assert desk.run("ddxvideoload", clip, "-readers", "1").returncode == 0
    wait_until(lambda: int(desk.stats("ddxvideosave")["in"]) == 20)
    status, saved = stop(saver)
    assert status == 0 and saved["in"] == 20 and balanced(saved) and saved["lost"]["write"] >= 19
    if reader is not None:
        os.close(reader)


@pytest.mark.parametrize("opened", [False, True])
def test_clip_from_a_pipe_without_writer(desk: Desk, clip: pathlib.Path, opened: bool) -> None:
    pipe = desk.folder / "pipe"
    os.mkfifo(pipe)
    loader = desk.start("ddxvideoload", pipe)
    if opened:
        with pipe.open("wb", buffering=0) as file:
            file.write(clip.read_bytes()[:PICTURE * 3])
            wait_until(lambda: desk.out("ddxvideoload") > 1)
            assert stop(loader)[0] == 0
    else:
        wait_until(lambda: b"ddxvideoload" in pathlib.Path(f"/proc/{loader.pid}/cmdline").read_bytes())
        wait_until(lambda: "SigCgt:\t0000000000000000" not in pathlib.Path(f"/proc/{loader.pid}/status").read_text())
        assert stop(loader)[0] == 0


def test_counters_into_a_full_pipe(desk: Desk, clip: pathlib.Path) -> None:
    """Standard output is a full pipe."""
    end, begin = os.pipe()
    os.set_blocking(begin, False)
    try:
        while os.write(begin, bytes(4096)):
            pass
    except BlockingIOError:
        os.set_blocking(begin, True)
    loader = subprocess.Popen([*MORTAL, ROOT / "bin/ddxvideoload", clip, "-loop"], env=desk.environment, stdout=begin)
    try:
        wait_until(lambda: desk.out("ddxvideoload") > 5)
        loader.terminate()
        assert loader.wait(60) == 0
    finally:
        loader.kill()
        os.close(begin)
        os.close(end)
