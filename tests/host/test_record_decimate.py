# SPDX-License-Identifier: GPL-2.0-or-later
"""A recorder that takes only some frames takes them evenly; the others count as skipped, not as lost."""
from __future__ import annotations

import pathlib
import signal

import pytest

from .programs import Desk, header_of, lost, pictures, start_recorder, stop, wait_until
from .test_pool import COUNT, clip, index_of, recordings, stall, start
from .test_record_commands import count, reached

pytestmark = pytest.mark.strict

__all__ = ["clip"]  # a fixture


@pytest.mark.parametrize("option, value, numbers, rate", [
    ("-skip", "1", range(COUNT), "F25:1"),
    ("-skip", "3", range(0, COUNT, 3), "F25:3"),
    ("-rate", "5", range(0, COUNT, 5), "F5:1"),
    ("-rate", "60", range(COUNT), "F25:1"),
    # 2 of 5, evenly: numbers 1, 3, 6, 8 ... of the store
    ("-rate", "10", [n for n in range(COUNT) if n % 5 in (0, 2)], "F10:1"),
])
def test_some_of_the_frames(desk: Desk, clip: pathlib.Path, option: str, value: str, numbers: range | list[int],
                            rate: str) -> None:
    saver = start_recorder(desk, "-output", "out.y4m", option, value)
    assert desk.run("ddxvideoload", clip, "-readers", "1").returncode == 0
    status, saved = stop(saver)
    assert status == 0 and lost(saved) == 0
    assert (saved["in"], saved["out"], saved["skipped"]) == (len(numbers), len(numbers), COUNT - len(numbers))
    played = pictures(clip)
    assert pictures(desk.folder / "out.y4m") == [played[number] for number in numbers]
    assert rate in header_of(desk.folder / "out.y4m").split()


def test_only_chosen_frames_count_as_lost(desk: Desk, clip: pathlib.Path) -> None:
    """The recorder is frozen for longer than frames are kept, and killed: the frames of every third that are missing in
    the files were counted as lost, and all others as skipped."""
    saver, loader = stall(desk, clip, "-skip", "3")
    wait_until(lambda: lost(desk.stats("ddxvideosave")) >= 10)
    taken = int(desk.stats("ddxvideosave")["in"])
    wait_until(lambda: desk.out("ddxvideosave") > taken)  # the index on the disk has it
    saver.send_signal(signal.SIGKILL)
    saver.wait()
    begin = desk.out("ddxvideoload")
    wait_until(lambda: desk.out("ddxvideoload") > begin + 30)
    saver = start(desk, "-skip", "3", "-keep", "8")
    out = desk.out("ddxvideosave")
    wait_until(lambda: desk.out("ddxvideosave") > out + 3)
    _, loaded = stop(loader)
    status, saved = stop(saver)
    assert status == 0
    found = [entry[1] for file in recordings(desk) for entry in index_of(file).entries]
    assert all((number - 1) % 3 == 0 for number in found) and found == sorted(set(found))
    wanted = len(range(0, loaded["out"], 3))
    assert (saved["in"], saved["out"], lost(saved)) == (wanted, len(found), wanted - len(found))
    assert saved["lost"]["store"] >= 10 and saved["lost"]["restart"] >= 8
    assert saved["skipped"] == loaded["out"] - wanted
    indexed = [entry[8] for file in recordings(desk) for entry in index_of(file).entries]
    assert sum(indexed) == saved["lost"]["store"]


def test_the_pre_roll_has_only_chosen_frames(desk: Desk, clip: pathlib.Path) -> None:
    saver = start(desk, "-skip", "5", "-start", "paused", "-pre-roll", "60", "-ring", "64")
    assert desk.run("ddxvideoload", clip, "-readers", "1").returncode == 0
    assert desk.run("ddxctl", "record", "start").returncode == 0
    status, saved = stop(saver)
    assert status == 0 and lost(saved) == 0
    assert [entry[1] for file in recordings(desk) for entry in index_of(file).entries] == list(range(1, COUNT + 1, 5))
    assert (saved["out"], saved["skipped"]) == (COUNT // 5, COUNT - COUNT // 5)


def test_only_chosen_frames_are_lost_in_the_pre_roll(desk: Desk, clip: pathlib.Path) -> None:
    """Also if the first frame after a gap, which reports the gap, is skipped itself."""
    saver = start(desk, "-keep", "8", "-skip", "5", "-start", "paused", "-pre-roll", "60", "-ring", "64")
    loader = desk.start("ddxvideoload", clip, "-loop", "-readers", "1", "-rate", "2")
    for _ in range(3):
        reached(desk, "skipped", count(desk, "skipped") + 8)
        saver.send_signal(signal.SIGSTOP)
        begin = desk.out("ddxvideoload")
        wait_until(lambda: desk.out("ddxvideoload") > begin + 25)
        saver.send_signal(signal.SIGCONT)
    reached(desk, "skipped", count(desk, "skipped") + 8)
    assert desk.run("ddxctl", "record", "start").returncode == 0
    wait_until(lambda: desk.out("ddxvideosave") > 0)
    _, loaded = stop(loader)
    status, saved = stop(saver)
    assert status == 0
    entries = [entry for file in recordings(desk) for entry in index_of(file).entries]
    wanted = len(range(entries[0][1] - 1, loaded["out"], 5))
    assert (saved["in"], saved["out"], lost(saved)) == (wanted, len(entries), wanted - len(entries))
    assert saved["skipped"] == loaded["out"] - wanted
    assert lost(saved) == sum(entry[8] for entry in entries) >= 3


@pytest.mark.parametrize("options, said", [
    (["-skip", "0"], "-skip"),
    (["-rate", "0"], "-rate 0: a number above 0, up to 1000, is needed"),
    (["-rate", "fast"], "-rate fast: a number above 0"),
    (["-rate", "5", "-skip", "2"], "-skip and -rate: one of them is enough"),
])
def test_wrong_choices(desk: Desk, options: list[str], said: str) -> None:
    done = desk.run("ddxvideosave", "-output", "out.y4m", *options)
    assert done.returncode == 2 and said in done.stderr
    assert not (desk.folder / "out.y4m").exists()
