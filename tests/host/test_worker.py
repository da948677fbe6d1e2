# SPDX-License-Identifier: GPL-2.0-or-later
"""The store's worker is killed repeatedly during a recording: no frame is lost or late."""
from __future__ import annotations

import json
import os
import pathlib
import signal
import time

import pytest

from lib.figures import Figure

from .programs import KEEP, Compiler, Desk, Process, lost, make_clip, pictures, stop, wait_until, worker_of

pytestmark = pytest.mark.retry

LATE = 50_000  # us; largest delay of a frame
RATE = 25      # frames a second
PAUSE = 0.1    # s between kills


def kill_worker(store: Process) -> None:
    """Kill the worker and wait for the next one."""
    before = worker_of(store)
    os.kill(before, signal.SIGKILL)
    wait_until(lambda: worker_of(store) not in (0, before))


def record(desk: Desk, clip: pathlib.Path, client: pathlib.Path, deaths: int, output: str = "out.y4m",
           keep: int = KEEP) -> dict[str, int]:
    """Kill `deaths` workers during a recording; return the result of a second reader."""
    frames = int(deaths * PAUSE * RATE) + RATE
    reader = desk.start(client, frames, keep)
    saver = desk.start("ddxvideosave", "-keep", keep, "-output", output)
    loader = desk.start("ddxvideoload", clip, "-loop", "-readers", 2)
    wait_until(lambda: desk.out("ddxvideosave") > 0)
    for _ in range(deaths):
        kill_worker(desk.store)
        time.sleep(PAUSE)
    seen = json.loads(reader.communicate(timeout=600)[0])
    _, loaded = stop(loader)
    status, saved = stop(saver)
    assert status == 0 and lost(saved) == 0, desk.errors(saver)
    assert saved["in"] == saved["out"] == loaded["out"] >= frames
    assert (seen["frames"], seen["missed"]) == (frames, 0)
    assert desk.errors(desk.store).count("the worker was killed by signal 9") == deaths
    assert json.loads(desk.run("ddxctl", "list", "--json").stdout)["restarts"] == deaths
    return {name: int(value) for name, value in seen.items()}


def test_workers_die_while_recording(desk: Desk, compile_client: Compiler) -> None:
    clip = make_clip(desk.folder / "clip.y4m", frames=RATE)
    record(desk, clip, compile_client("late_client", "ddx"), 40)
    frames, one_round = pictures(desk.folder / "out.y4m"), pictures(clip)
    assert len(frames) > RATE and all(frame == one_round[i % RATE] for i, frame in enumerate(frames))


@pytest.mark.long
@pytest.mark.parametrize("size, keep", [("352x288", KEEP), ("1920x1080", 16)])
def test_a_thousand_workers_die_while_recording(tmp_path: pathlib.Path, compile_client: Compiler, size: str, keep: int,
                                                record_property: Figure) -> None:
    """At 1080p nothing is written to disk, which would be too slow."""
    desk = Desk(tmp_path, memory="512M")
    clip = make_clip(desk.folder / "clip.y4m", size, frames=RATE)
    seen = record(desk, clip, compile_client("late_client", "ddx"), 1000, "/dev/null", keep)
    desk.end()
    for name, value in seen.items():
        record_property(name, value)
    assert seen["late_us"] <= LATE
