# SPDX-License-Identifier: GPL-2.0-or-later
"""An encoder that takes all of one processor: the robot's other programs run nevertheless."""
from __future__ import annotations

import json
import os
import pathlib
from collections.abc import Iterator

import pytest

from parts.guest import session, testdisk
from parts.guest.native_machine import NativeMachine
from parts.guest.session import LOAD, SAVE

from .programs import ffmpeg

pytestmark = [pytest.mark.retry, pytest.mark.long]


@pytest.fixture
def robot(root: pathlib.Path, tmp_path: pathlib.Path) -> Iterator[NativeMachine]:
    """On one processor, whatever this machine has. Its clip is noise, of which it can encode a part only."""
    clip = tmp_path / "clip.y4m"
    clip.write_bytes(ffmpeg("-f", "lavfi", "-i", "nullsrc=size=1280x720:rate=200,noise=alls=100:allf=t", "-frames:v",
                            "10", "-pix_fmt", "yuv420p", "-f", "yuv4mpegpipe", "-"))
    keep = tmp_path / "keep"
    (keep / "test").mkdir(parents=True)
    testdisk.fill(keep / "test", clip, {f"{LOAD}.conf": "loop=\n",
                                        f"{SAVE}.conf": "format=h264\nquality=10\nsegment=64\nfull=recycle\n"})
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(before)})
    try:
        with NativeMachine(root, keep) as machine:
            yield machine
    finally:
        os.sched_setaffinity(0, before)


def test_health_answers(robot: NativeMachine) -> None:
    """Health names the encoder, which gives up its real-time priority; a frame that is not encoded is counted. On a
    busy machine the encoder gets less of the processor then, and takes its priority back: so each is waited for."""
    robot.wait_until(f"chrt -p $(pidof {SAVE}) | grep -q SCHED_FIFO")
    robot.wait_until("ddxctl health --json > /tmp/said; grep -q 'encoding takes [89]. % of a processor' /tmp/said")
    line = next(one for one in map(json.loads, robot.sh("cat /tmp/said").splitlines()) if one["title"] == "recorder")
    assert line["complaint"] and "skip=2, a higher quality= or format=y4m take less" in line["text"]
    robot.wait_until(f"chrt -p $(pidof {SAVE}) | grep -q SCHED_OTHER")
    robot.sh(f"/etc/init.d/S*{LOAD} stop; /etc/init.d/S*{SAVE} stop")
    counters = session.end_counters(robot, SAVE)
    assert counters.lost["store"] > 0 and counters.frames_in == counters.out + counters.lost_total
