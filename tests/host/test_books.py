# SPDX-License-Identifier: GPL-2.0-or-later
"""No frame goes unmentioned: what the writer wrote is in a file, or some book says why it is not."""
from __future__ import annotations

import json
import pathlib
import signal
import subprocess
from collections.abc import Iterator

import pytest

from .programs import Counters, Desk, Process, lost, make_clip, pictures, result, start_recorder, stop, wait_until

PICTURE = 64 * 48 * 3 // 2


@pytest.fixture
def clip(desk: Desk) -> pathlib.Path:
    return make_clip(desk.folder / "clip.y4m", "64x48", "100", 50)


@pytest.fixture
def small_disk(tmp_path: pathlib.Path) -> Iterator[pathlib.Path]:
    folder = tmp_path / "small"
    folder.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=64k", "none", folder], capture_output=True, text=True)
    if mounted.returncode:
        pytest.skip(f"cannot mount a small file system: {mounted.stderr.strip()}")
    yield folder
    subprocess.run(["umount", "-l", folder], check=True)


def attached(desk: Desk) -> bool:
    """What is written from now on is the recorder's business, and the store knows that."""
    book = desk.run("ddxctl", "show", "ddxvideosave.stats", "--json").stdout
    return bool(desk.readers("video")) and '"running":1' in book and '"follows":0' not in book


def idle_loader(desk: Desk, clip: pathlib.Path) -> Process:
    """The item is there, and nothing is written before there are two readers."""
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
    """It had not read a frame yet: those that went by are lost, not unmentioned."""
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
    """Before its first frame; what is written until its successor comes is lost, and counted."""
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


def test_told_to_stop_and_its_successor_killed(desk: Desk, clip: pathlib.Path) -> None:
    """Nobody wanted the frames after the stop, also when somebody who saw none of them dies."""
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
    """A recorder that has the whole clip."""
    saver = start_recorder(desk, "-output", "out.y4m", *options)
    assert desk.run("ddxvideoload", clip, "-readers", "1").returncode == 0
    wait_until(lambda: int(desk.stats("ddxvideosave")["out"]) == 50)
    return saver


def test_books_are_kept_longer_than_pictures(tmp_path: pathlib.Path) -> None:
    """Memory is needed, nobody has the items open: pictures go, and a dead program's losses stay known."""
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

def test_full_disk_again_and_again(desk: Desk, clip: pathlib.Path, small_disk: pathlib.Path) -> None:
    """Each recorder that a full disk ends leaves a gap to the next; none of it is forgotten."""
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
    """What comes behind the change is lost, and counted: by the recorder, or by its successor."""
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
    """To be preloaded: the program is killed right before or after a call."""
    library = tmp_path_factory.mktemp("act") / "last_act.so"
    subprocess.run(["gcc", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC",
                    pathlib.Path(__file__).with_name("last_act.c"), "-o", library], check=True)
    return library


@pytest.mark.parametrize("moment, out", [("before", 11), ("after", 12)])
def test_writer_killed_while_it_publishes(desk: Desk, clip: pathlib.Path, last_act: pathlib.Path, moment: str,
                                          out: int) -> None:
    """The frame is in the item or not, and its successor's book says the same."""
    wrapper = ("env", f"LD_PRELOAD={last_act}", f"LAST_ACT={moment}", "LAST_CALL=12")
    loader = desk.start("ddxvideoload", clip, "-rate", "0", wrapper=wrapper)
    assert loader.wait(60) == -signal.SIGKILL and desk.sequence("video") == out
    again = desk.run("ddxvideoload", clip, "-rate", "0")
    loaded = json.loads(again.stdout.splitlines()[-1])
    assert loaded["out"] == out + 50 == desk.sequence("video") and balanced(loaded)
    assert loaded["in"] == 62 and loaded["lost"]["restart"] == 12 - out
