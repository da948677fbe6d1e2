# SPDX-License-Identifier: GPL-2.0-or-later
"""IIDC cameras on USB: every mode, parts of the picture, two cameras at once, many times unplugged."""
import pathlib
from collections.abc import Iterator

import pytest

from parts.guest import qemu
from parts.guest.machine import Machine
from parts.guest.qemu import Guest

from . import camera, iidc
from .iidc import FRAMES, Camera, Grabber, expected, wrong

pytestmark = pytest.mark.long
MODES = ["160x120_YUV444", "320x240_YUV422", "640x480_YUV411", "640x480_YUV422", "640x480_RGB8", "640x480_MONO8",
         "640x480_MONO16"]
REPLUGS = 20


@pytest.fixture(scope="module")
def guest(boot: qemu.Boot, work: pathlib.Path, board: Machine) -> Iterator[Guest]:
    with iidc.booted(boot, work, board, "camera-iidc-long") as running:
        yield running


def test_each_mode(guest: Guest) -> None:
    one = Camera(guest, ms=100)
    one.plug()
    for mode in MODES:
        grabber = Grabber(guest, f"-mode {mode} -rate 7.5", mode)
        grabber.wait(4)
        run = grabber.stop()
        size = {f"{frame.width}x{frame.height}" for frame in run.frames}
        assert (size, run.counters.lost["error"]) == ({mode.split("_")[0]}, 0), run.said
    one.unplug()


def test_parts_of_the_picture(guest: Guest) -> None:
    one = Camera(guest)
    one.plug()
    for left, top, width, height in [(0, 0, 176, 72), (4, 8, 64, 64), (112, 136, 64, 8)]:
        name = f"roi{left}"
        grabber = Grabber(guest, f"-format MONO8 -roi {left},{top},{width},{height}", name)
        grabber.wait(FRAMES)
        run = grabber.stop()
        pictures = [iidc.marked("MONO8", iidc.sent("MONO8", number)[top:top + height, left:left + width])
                    for number in range(FRAMES)]
        grey = bytes([128]) * (width * height // 2)
        assert wrong(run, camera.checksums([picture.tobytes() + grey for picture in pictures], width, height)) == []
    status, text = guest.shell().run(f"chpst -u {iidc.USER}:ddx timeout 3 {iidc.GRABBER} -roi 2,0,64,64 2>&1")
    assert "176x144, in steps of 4x4, at steps of 4x4" in text, status
    one.unplug()


def test_two_cameras_are_two_instances(guest: Guest) -> None:
    """Each is found by its GUID; when one is unplugged, the other one goes on."""
    cameras = [Camera(guest, port, f"00b09d010000000{port}") for port in (0, 1)]
    for one in cameras:
        one.plug()
    grabbers = [Grabber(guest, f"-camera {one.guid} -format MONO8", f"eye{one.port}") for one in cameras]
    for grabber in grabbers:
        grabber.wait(FRAMES)
    cameras[0].unplug()
    grabbers[0].wait_said("unplugged")
    grabbers[1].wait_for_more()
    cameras[0].plug()
    grabbers[0].wait_for_more()
    runs = [grabber.stop() for grabber in grabbers]
    for run in runs:
        assert wrong(run, expected("MONO8", True)) == []
    assert runs[0].counters.lost["away"] > 0 == runs[1].counters.lost["away"]
    for one in cameras:
        one.unplug()


def test_many_times_unplugged(guest: Guest) -> None:
    one = Camera(guest)
    grabber = Grabber(guest, "-format MONO8", "often")
    for number in range(REPLUGS):
        one.plug()
        grabber.wait_for_more(2)
        one.unplug()
        grabber.wait_said("unplugged", number + 1)
    run = grabber.stop()
    assert wrong(run, expected("MONO8", True)) == []
    assert sum("back after" in line for line in run.said) == REPLUGS - 1
