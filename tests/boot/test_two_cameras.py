# SPDX-License-Identifier: GPL-2.0-or-later
"""Two cameras, each with its own recorder, on one disk: all frames of each, and none of the other."""
import pathlib
import time

import pytest

from lib.figures import Figure
from parts.guest import guest_camera, qemu, session
from parts.guest.guest_camera import GRABBER
from parts.guest.machine import Machine
from parts.guest.session import SAVE
from parts.media import clip as default_clip, y4m
from parts.media.recording import FileSystem

from . import camera

pytestmark = [pytest.mark.strict, pytest.mark.long]

SIZES = {"video": (352, 288), "rear": (176, 144)}
SECONDS = 10


def test_each_is_recorded(boot: qemu.Boot, work: pathlib.Path, board: Machine, record_property: Figure) -> None:
    clip = default_clip.write(work / "unused.y4m", 1)
    disk = camera.disk(work, board.board, clip, {f"{SAVE}.conf": "segment=16\n"})
    with boot("two-cameras", test_disk=disk, more_memory=128) as guest:
        camera.prepare(guest)
        guest.sh(f"ddxctl add {SAVE}.rear name=rear segment=16")
        guest.wait_until(f"ddxctl stats --json | grep -q {SAVE}.rear")  # both recorders run before the cameras
        for item, instance, number in [("video", GRABBER, 0), ("rear", f"{GRABBER}.rear", 2)]:
            size = "CIF" if item == "video" else "QCIF"
            settings = f"camera={number}\\nname={item}\\ninput=S-Video\\nstandard=PAL\\nformat=YU12\\nsize={size}\\n"
            guest.sh(f"printf '{settings}' > /data/ddx/{instance}.conf")
        guest.sh(f"/etc/init.d/S*{GRABBER} restart")
        guest_camera.vivid(guest, "n_devs=2 node_types=0x101,0x101")  # each a camera and an output
        camera.wait_for_frames(guest, instance=GRABBER)
        camera.wait_for_frames(guest, instance=f"{GRABBER}.rear")
        time.sleep(SECONDS)
        guest.sh(f"/etc/init.d/S*{GRABBER} stop")
        session.stop_recorder(guest)
        partition = FileSystem(guest.snapshot())
        print(*partition.lost(), sep="\n")
        for item, instance in [("video", ""), ("rear", ".rear")]:
            grab, save = (session.end_counters(guest, name + instance) for name in (GRABBER, SAVE))
            record_property(item, {"driver_lost": grab.lost["driver"], "in": save.frames_in, "out": save.out})
            assert save.lost_total == 0 and grab.out == save.frames_in == save.out > 20 * SECONDS, (grab, save)
            header, frames = y4m.read(partition.take_only(item, work / f"two-{item}.y4m"))
            assert (header.width, header.height) == SIZES[item]
            times = [frame.time or 0 for frame in frames]
            assert len(times) == save.out and times == sorted(set(times))
