# SPDX-License-Identifier: GPL-2.0-or-later
"""Another user's program occupies the names of items that only publish a program's state: each program works without
them, and reports it."""
from __future__ import annotations

import pathlib
import subprocess
import sys
from collections.abc import Callable, Iterator

import pytest

from parts.common import MORTAL
from parts.media import clip as numbered_clip

from .log_rules import CONFIG, only
from .programs import TOP, Desk, Process, lost, make_clip, pictures, start_recorder, stop, wait_until
from .stream import Stream, finish

pytestmark = pytest.mark.retry

SQUATTER = """
import sys, ddx
store = ddx.Store(timeout=30)
items = [store.create(name, sys.argv[1], "struct { unsigned int a[3]; }") for name in sys.argv[2:]]
for item in items:
    item.write({"a": [1, 2, 3]})
print("ready", flush=True)
sys.stdin.read()
"""
Squat = Callable[..., None]


@pytest.fixture
def squat(tmp_path: pathlib.Path) -> Iterator[Squat]:
    """Take names and keep them."""
    squatters = []

    def take(desk: Desk, *names: str, type: str = "X") -> None:
        squatter = subprocess.Popen([*MORTAL, sys.executable, "-B", "-c", SQUATTER, type, *names],
                                    stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
                                    env={**desk.environment, "PYTHONPATH": str(TOP / "package/ddx/python")})
        squatters.append(squatter)
        assert squatter.stdout and squatter.stdout.readline() == "ready\n"

    yield take
    for squatter in squatters:
        squatter.communicate("")


def without(desk: Desk, process: Process, item: str, why: str = "the item has another type") -> None:
    def found() -> bool:
        return any(f" {item}: {why}" in line and line.endswith("; going on without it")
                   for line in desk.errors(process).splitlines())

    wait_until(lambda: found() or process.poll() is not None)
    assert found(), desk.errors(process)


@pytest.mark.strict
def test_a_clip_is_played_and_recorded(desk: Desk, squat: Squat) -> None:
    squat(desk, *(f"ddxvideosave.{what}" for what in ("stats", "disk", "request", "answer")),
          "ddxvideoload.stats", "video.frame", "video.parameters")
    (desk.folder / "rec").mkdir()
    clip = make_clip(desk.folder / "clip.y4m", "64x48", "100", 20)
    saver = start_recorder(desk, "-output", "rec", "-segment", "4")
    without(desk, saver, "ddxvideosave.stats")
    loader = desk.run("ddxvideoload", clip, "-readers", "1")
    assert loader.returncode == 0, loader.stderr
    for item in "ddxvideoload.stats", "video.frame", "video.parameters":
        assert f"ddxvideoload: {item}: the item has another type" in loader.stderr
    status, saved = stop(saver)
    assert status == 0 and saved["in"] == saved["out"] == 20 and lost(saved) == 0
    assert pictures(next((desk.folder / "rec").glob("*.y4m"))) == pictures(clip)


def test_an_item_with_the_name_of_counters_but_another_type(desk: Desk, squat: Squat) -> None:
    """Its writer runs, but is no other instance of the recorder. If the last recorder's exit is unknown, its file is
    kept."""
    squat(desk, "ddxvideosave.stats", type="DDX_STATS")
    clip = make_clip(desk.folder / "clip.y4m", "64x48", "100", 20)
    (desk.folder / "out.y4m").write_text("older")
    saver = start_recorder(desk, "-output", "out.y4m")
    without(desk, saver, "ddxvideosave.stats", "wrong size: the item's value does not fit the program's struct")
    assert desk.run("ddxvideoload", clip, "-readers", "1").returncode == 0
    assert stop(saver)[0] == 0
    assert (desk.folder / "out.y4m").read_text() == "older"
    assert pictures(desk.folder / "out-2.y4m") == pictures(clip)


def test_a_stream(stream: Stream, squat: Squat) -> None:
    squat(stream.desk, "ddxdecode.stats", "ddxdecode.packets", "ddxvideosend.stats", "ddxvideosend.packets")
    clip = numbered_clip.write(stream.folder / "clip.y4m", 1)
    clip.write_bytes(b"FRAME".join(clip.read_bytes().split(b"FRAME")[:11]))
    decode = stream.decode()
    without(stream.desk, decode, "ddxdecode.packets")
    sender = stream.send()
    stream.play(clip, "-rate", "0.5")
    (_, _, sent), (_, _, shown) = finish(sender, decode)
    assert sent["in"] == sent["out"] == shown["in"] == shown["out"] == 10
    for program, process in ("ddxdecode", decode), ("ddxvideosend", sender):
        without(stream.desk, process, f"{program}.stats")
        without(stream.desk, process, f"{program}.packets")


def test_a_log(desk: Desk, squat: Squat) -> None:
    squat(desk, "ddxlog.stats")
    (desk.folder / "ddxlog.conf").write_text(CONFIG)
    logger = desk.start("ddxlog", "-c", "ddxlog.conf")
    without(desk, logger, "ddxlog.stats")
    squat(desk, "value")
    wait_until(lambda: any((desk.folder / "log").glob("*.mcap")))
    status, counters = stop(logger)
    assert status == 0 and counters["in"] == counters["out"] == 1
    assert only(desk).stat().st_size > 0


def test_a_camera(desk: Desk, squat: Squat) -> None:
    squat(desk, "ddxvideoV4L.stats")
    grabber = desk.start("ddxvideoV4L", "-camera", "99")
    without(desk, grabber, "ddxvideoV4L.stats")
    assert stop(grabber)[0] == 0
