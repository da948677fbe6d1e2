# SPDX-License-Identifier: GPL-2.0-or-later
"""Numbers and names of recordings: no foreign file stops the recorder, and no two recordings share a number."""
from __future__ import annotations

import json
import pathlib
import signal

import pytest

from .programs import Desk, lost, make_clip, pictures, start_recorder, stop, wait_until
from .test_pool import SEGMENT, recordings
from .test_pool import small_disk as pool_disk

pytestmark = pytest.mark.strict

__all__ = ["pool_disk"]  # a fixture

FRAMES = 30  # CIF frames: more than one file holds


@pytest.fixture
def clip(desk: Desk) -> pathlib.Path:
    (desk.folder / "rec/pool").mkdir(parents=True, exist_ok=True)
    return make_clip(desk.folder / "clip.y4m", frames=FRAMES)


def record(desk: Desk, clip: pathlib.Path, *options: object, name: str = "video") -> str:
    """Record all of the clip into new files; return the recorder's messages."""
    before = recordings(desk)
    saver = start_recorder(desk, "-output", "rec", "-segment", SEGMENT >> 20, "-name", name, *options)
    loader = desk.run("ddxvideoload", clip, "-readers", "1", "-rate", "3", "-name", name)
    assert loader.returncode == 0, loader.stderr
    status, saved = stop(saver)
    assert status == 0 and lost(saved) == 0, desk.errors(saver)
    new = [file for file in recordings(desk) if file not in before]
    assert [picture for file in new for picture in pictures(file)] == pictures(clip)
    return desk.errors(saver)


def test_strange_names_in_the_pool(desk: Desk, clip: pathlib.Path) -> None:
    """Only a name in the pool's form, up to its highest number, is a file of the pool."""
    pool = desk.folder / "rec/pool"
    strays = [pool / name for name in ["9223372036854775807.y4m", "9223372036854775808.index", "2147483647.y4m",
                                       "1000000000.y4m", "7.y4m", " 7.y4m", "+7.y4m", "-1.y4m", "000000.y4m"]]
    highest = pool / "999999999.y4m"
    for file in strays + [highest]:
        file.touch()
    record(desk, clip)
    assert not any(file.stat().st_size for file in strays)
    own = {one.stem for one in pool.iterdir() if one not in strays and one.name != "lock"}
    assert own <= {highest.stem, *(f"{number:06}" for number in range(1, 20))}
    assert desk.run("ddxrecordings", "list", "-folder", "rec").stderr == ""


def numbers(desk: Desk) -> list[int]:
    return [int(file.name.split("-")[-2]) for file in recordings(desk)]


def test_an_item_that_is_named_like_a_file(desk: Desk, clip: pathlib.Path) -> None:
    """Its numbers continue at the next start, and `list` shows its recordings as two."""
    for _ in range(2):
        record(desk, clip, name="a.y4m")
    assert numbers(desk) == [1, 2, 3, 4]
    lines = desk.run("ddxrecordings", "list", "-json", "-folder", "rec").stdout.splitlines()
    assert [json.loads(line)["recording"] for line in lines] == ["a.y4m-000001", "a.y4m-000003"]


def test_its_recordings_make_room_on_a_full_disk(desk: Desk, pool_disk: pathlib.Path, clip: pathlib.Path) -> None:
    """Also if a foreign file has the same number."""
    (pool_disk / "filler").write_bytes(bytes(20 << 20))  # leaves room for two recordings
    record(desk, clip, name="a.y4m")
    (pool_disk / "a-000001-20000101T000000Z.y4m").touch()
    for _ in range(2):
        saver = start_recorder(desk, "-output", "rec", "-segment", 4, "-name", "a.y4m", "-full", "recycle")
        desk.run("ddxvideoload", clip, "-readers", "1", "-rate", "3", "-name", "a.y4m")
        status, saved = stop(saver)
        assert (status, lost(saved)) == (0, 0), desk.errors(saver)
    assert sorted(numbers(desk))[0] == 1 and sorted(numbers(desk))[1] > 2


def test_two_recorders_of_one_item_that_start_at_once(desk: Desk, clip: pathlib.Path) -> None:
    """Both take their numbers at the item's first frame, long before either is on the disk."""
    savers = [start_recorder(desk, "-output", "rec", "-segment", 4, "-instance", name) for name in ("one", "two")]
    assert desk.run("ddxvideoload", clip, "-readers", "2", "-rate", "3").returncode == 0
    for saver in savers:
        status, saved = stop(saver)
        assert status == 0 and saved["out"] == FRAMES and lost(saved) == 0
        assert "another file" not in desk.errors(saver)
    assert numbers(desk) == [1, 2, 3, 4]
    shown = [picture for file in recordings(desk) for picture in pictures(file)]
    assert sorted(shown) == sorted(2 * pictures(clip))


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_a_name_that_another_file_has(desk: Desk, clip: pathlib.Path, number: int) -> None:
    """The recording gets another number but keeps its time, when it ends or is recovered; the other file stays."""
    saver = start_recorder(desk, "-output", "rec", "-segment", 64)  # one file, even on a slow machine
    loader = desk.start("ddxvideoload", clip, "-readers", "1", "-loop")
    wait_until(lambda: desk.out("ddxvideosave") > 0)
    name, = json.loads(desk.run("ddxrecordings", "list", "-json", "-folder", "rec").stdout)["files"]
    other = desk.folder / "rec" / name
    other.write_bytes(b"other")
    stop(loader)
    saver.send_signal(number)
    assert saver.wait(60) in (0, -number)
    recover = desk.run("ddxvideosave", "-output", "rec", "-segment", "64", "-recover")
    assert f"rec/{name}: another file has this name" in desk.errors(saver) + recover.stderr
    assert other.read_bytes() == b"other"
    found = next(file for file in recordings(desk) if file != other)
    assert found.name.split("-")[1] != "000001" and found.name.split("-")[2] == name.split("-")[2]
    shown, once = pictures(found), pictures(clip)
    again = len(shown) // len(once) + 1  # the clip may start again on a slow machine
    assert shown and shown == (again * once)[:len(shown)]
    assert f"{found.name}: good" in desk.run("ddxrecordings", "verify", found.name, "-folder", "rec").stdout
    assert desk.run("ddxvideosave", "-output", "rec", "-segment", "64", "-recover").stderr == ""
