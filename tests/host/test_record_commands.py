# SPDX-License-Identifier: GPL-2.0-or-later
"""Commands to a recorder: stop, continue, begin a new file. Each frame is in a file or skipped on request."""
from __future__ import annotations

import json
import os
import pathlib

import pytest

from .programs import Desk, lost, pictures, start_recorder, stop, wait_until
from .test_pool import COUNT, PICTURE, check_files, clip, index_of, recordings, start
from .test_recordings import listed

pytestmark = pytest.mark.strict

__all__ = ["clip"]  # a fixture


def command(desk: Desk, *words: str) -> None:
    done = desk.run("ddxctl", "record", *words)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def count(desk: Desk, what: str) -> int:
    """One of the recorder's counters; 0 while it has none."""
    lines = desk.run("ddxctl", "stats", "--json").stdout.splitlines()
    return sum(int(one[what]) for line in lines if (one := json.loads(line))["instance"] == "ddxvideosave")


def reached(desk: Desk, what: str, number: int) -> None:
    wait_until(lambda: count(desk, what) > number)


def sequences(desk: Desk) -> list[int]:
    return [entry[1] for file in recordings(desk) for entry in index_of(file).entries]


def test_split_loses_nothing(desk: Desk, clip: pathlib.Path) -> None:
    saver = start(desk)
    loader = desk.start("ddxvideoload", clip, "-readers", "1", "-rate", "0.5")
    for out in 10, 30, 50, 70:
        reached(desk, "in", out)
        command(desk, "split")
    assert loader.wait(60) == 0
    status, saved = stop(saver)
    assert status == 0 and saved["in"] == saved["out"] == COUNT and lost(saved) == 0
    assert sequences(desk) == list(range(1, COUNT + 1))
    assert [picture for file in recordings(desk) for picture in pictures(file)] == pictures(clip)
    found = listed(desk)
    assert len(found) == 5 and sum(one["frames"] for one in found) == COUNT


def test_split_without_a_pool(desk: Desk, clip: pathlib.Path) -> None:
    saver = start_recorder(desk, "-output", "rec")
    loader = desk.start("ddxvideoload", clip, "-readers", "1")
    reached(desk, "in", 20)
    command(desk, "split")
    assert loader.wait(60) == 0
    _, saved = stop(saver)
    assert saved["in"] == saved["out"] == COUNT and len(recordings(desk)) == 2
    assert [picture for file in recordings(desk) for picture in pictures(file)] == pictures(clip)


def test_stop_and_start(desk: Desk, clip: pathlib.Path) -> None:
    saver = start(desk)
    loader = desk.start("ddxvideoload", clip, "-loop", "-readers", "1")
    wait_until(lambda: desk.out("ddxvideosave") > 10)
    command(desk, "stop")
    wait_until(lambda: [one["state"] for one in listed(desk)] == ["finished"])
    before = desk.stats("ddxvideosave")
    reached(desk, "skipped", before["skipped"] + 10)
    now = desk.stats("ddxvideosave")
    assert now["in"] == now["out"] == before["in"] == len(sequences(desk))
    command(desk, "start")
    command(desk, "start")  # already started
    reached(desk, "out", now["out"] + 10)
    _, loaded = stop(loader)
    status, saved = stop(saver)
    assert status == 0 and lost(saved) == 0 and saved["skipped"] > 10
    assert loaded["out"] == saved["in"] + saved["skipped"] and saved["in"] == saved["out"]
    found = sequences(desk)
    gaps = [(one, later) for one, later in zip(found, found[1:]) if later != one + 1]
    assert len(gaps) == 1 and gaps[0][1] - gaps[0][0] - 1 == saved["skipped"]
    assert check_files(desk, pictures(clip)) == saved["out"] and len(listed(desk)) == 2
    assert all(sum(one["lost"].values()) == 0 for one in listed(desk))


def test_the_state_of_the_disk_is_reported(desk: Desk, clip: pathlib.Path) -> None:
    """Compared with the file system, the pool and the clip's rate."""
    def report() -> dict[str, int]:
        shown = desk.run("ddxctl", "show", "ddxvideosave.disk", "--json").stdout
        found: dict[str, int] = json.loads(shown)["value"] if shown else {"ready": 0, "rate": 0}
        return found

    saver = start(desk)
    loader = desk.start("ddxvideoload", clip, "-loop", "-readers", "1")
    # The first report was made before there was a recording.
    wait_until(lambda: report()["ready"] >= 2 and abs(report()["rate"] - 25 * PICTURE) < 5 * PICTURE)
    now, disk = report(), os.statvfs(desk.folder / "rec")
    assert now["recording"] == 1
    assert abs(now["free"] - disk.f_bavail * disk.f_frsize) < 1 << 30
    assert abs(now["usable"] - now["free"]) < 64 << 20
    assert abs(now["seconds_left"] - now["usable"] // now["rate"]) <= 1
    command(desk, "stop")
    wait_until(lambda: report()["recording"] == 0 and report()["rate"] == 0 and report()["seconds_left"] == -1)
    stop(loader)
    stop(saver)


def test_begins_paused_on_request(desk: Desk, clip: pathlib.Path) -> None:
    saver = start(desk, "-start", "paused")
    assert desk.run("ddxvideoload", clip, "-readers", "1", "-rate", "3").returncode == 0
    refused = desk.run("ddxctl", "record", "split")
    assert refused.returncode == 2 and "it does not record now" in refused.stderr
    command(desk, "start", "ddxvideosave")
    _, saved = stop(saver)
    assert (saved["in"], saved["out"], saved["skipped"]) == (0, 0, COUNT) and recordings(desk) == []


def test_frames_skipped_before_a_kill_are_not_lost(desk: Desk, clip: pathlib.Path) -> None:
    saver = start(desk, "-start", "paused")
    loader = desk.start("ddxvideoload", clip, "-loop")
    reached(desk, "skipped", 20)
    skipped = desk.stats("ddxvideosave")["skipped"]
    saver.kill()
    saver.wait()
    saver = start(desk)
    wait_until(lambda: desk.out("ddxvideosave") > 5)
    _, loaded = stop(loader)
    _, saved = stop(saver)
    assert saved["skipped"] >= skipped and saved["in"] == saved["out"] + lost(saved)
    assert saved["in"] + saved["skipped"] <= loaded["out"]


@pytest.mark.parametrize("words, status, says", [
    ([], 2, "record: needs a word"),
    (["go"], 2, "record: go: start, stop, split or pre-roll SECONDS is needed"),
    (["stop", "ddxvideosave", "now"], 2, "record: now: "),
    (["pre-roll"], 2, "record: pre-roll: "),
    (["pre-roll", "x"], 2, "record: x: "),
    (["stop", "rear"], 1, "no recorder rear is running"),
])
def test_wrong_words(desk: Desk, words: list[str], status: int, says: str) -> None:
    done = desk.run("ddxctl", "record", *words)
    assert done.returncode == status and says in done.stderr and len(done.stderr.splitlines()) == 1


def test_pre_roll(desk: Desk, clip: pathlib.Path) -> None:
    """Frames of the second before the command are recorded, without a gap to the next frames."""
    saver = start(desk, "-start", "paused")
    loader = desk.start("ddxvideoload", clip, "-loop", "-readers", "1")
    reached(desk, "skipped", 0)
    too_much = desk.run("ddxctl", "record", "pre-roll", "60")
    assert too_much.returncode == 2 and "do not fit into memory, 1 s do" in too_much.stderr
    command(desk, "pre-roll", "1")
    reached(desk, "skipped", count(desk, "skipped") + 10)  # by then a second's frames wait, and the oldest are dropped
    command(desk, "start")
    reached(desk, "out", 40)
    _, loaded = stop(loader)
    status, saved = stop(saver)
    assert status == 0 and lost(saved) == 0 and saved["in"] + saved["skipped"] == loaded["out"]
    found = sequences(desk)
    assert found == list(range(found[0], loaded["out"] + 1)) and len(found) == saved["out"]
    assert found[0] == saved["skipped"] + 1
    moments = [entry[2] for file in recordings(desk) for entry in index_of(file).entries]
    assert saved["latency_us"]["max"] > 900_000  # the oldest frame waited that long
    assert [later - one for one, later in zip(moments, moments[1:])] == [40_000_000] * (len(moments) - 1)
    assert check_files(desk, pictures(clip)) == saved["out"]


def test_commands_before_the_first_frame(desk: Desk, clip: pathlib.Path) -> None:
    saver = start(desk)
    loader = desk.start("ddxvideoload", clip, "-readers", "2")  # creates the item and waits
    wait_until(lambda: desk.run("ddxctl", "record", "stop").returncode == 0)
    command(desk, "pre-roll", "50")
    command(desk, "start")
    command(desk, "split")
    assert desk.start("ddxctl", "watch", "video", "-count", "1").wait(60) == 0
    assert loader.wait(60) == 0
    _, saved = stop(saver)
    assert saved["out"] == COUNT and len(listed(desk)) == 1


def test_pre_roll_frames_that_were_not_requested_are_skipped(desk: Desk, clip: pathlib.Path) -> None:
    saver = start(desk, "-start", "paused", "-pre-roll", "1")
    assert desk.run("ddxvideoload", clip, "-readers", "1").returncode == 0
    wait_until(lambda: 0 < COUNT - count(desk, "skipped") <= 30)  # a second's frames wait; fewer if slow
    _, saved = stop(saver)
    assert (saved["in"], saved["out"], saved["skipped"]) == (0, 0, COUNT)


def test_one_file_is_one_recording(desk: Desk, clip: pathlib.Path) -> None:
    saver = start_recorder(desk, "-output", "one.y4m")
    loader = desk.start("ddxvideoload", clip, "-readers", "1")
    wait_until(lambda: desk.out("ddxvideosave") > 5)
    done = desk.run("ddxctl", "record", "stop")
    assert done.returncode == 2 and "records into one file" in done.stderr
    assert loader.wait(60) == 0 and stop(saver)[1]["out"] == COUNT
    bad = desk.run("ddxvideosave", "-output", "one.y4m", "-start", "paused")
    assert bad.returncode == 2 and "is no folder" in bad.stderr
