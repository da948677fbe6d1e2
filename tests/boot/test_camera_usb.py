# SPDX-License-Identifier: GPL-2.0-or-later
"""A USB camera: uvcvideo is real; a program behind vhci_hcd simulates the camera and numbers its frames."""
import pathlib
import time

import pytest

from parts.guest import session
from parts.guest.qemu import Guest
from parts.media.clip import HEIGHT, WIDTH, picture
from parts.media.recording import FileSystem

from . import camera
from .camera import GRABBER, plug, unplug

pytestmark = pytest.mark.strict

SOON = 2.0  # s
NODE = "/dev/video0"
FRAMES = 25


@pytest.fixture(scope="module")
def guest(bus_guest: Guest) -> Guest:
    return bus_guest


def missing(frames: list[camera.Frame]) -> int:
    """The count of frames missing between pictures, by the numbers in the pictures."""
    known = {check: number for number, check in
             enumerate(camera.checksums((picture(number) for number in range(FRAMES)), WIDTH, HEIGHT))}
    shown = [known[frame.checksum] for frame in frames]
    return sum((after - before - 1) % FRAMES for before, after in zip(shown, shown[1:]))


def test_every_frame_comes_out_bit_exact(guest: Guest) -> None:
    plug(guest)
    result = camera.run_grabber(guest, "", 4)
    assert result.wrong == []
    assert missing(result.frames) == result.counters.lost_total == camera.gaps(result.frames)
    assert unplug(guest).startswith("sent ")


def test_counted_losses_match_the_numbers_in_the_pictures(guest: Guest) -> None:
    """The grabber is frozen for two seconds: the driver runs out of buffers and drops frames."""
    def freeze() -> None:
        guest.sh(f"p=$(cat /run/service/{GRABBER}/supervise/pid); kill -STOP $p; sleep 2; kill -CONT $p")
        camera.wait_for_frames(guest, 3)

    plug(guest)
    result = camera.run_grabber(guest, "", 4, freeze)
    assert result.wrong == []
    assert missing(result.frames) == result.counters.lost["driver"] == result.counters.lost_total > 5
    del result.frames[3]  # proves that the check can fail
    assert missing(result.frames) != result.counters.lost["driver"]
    unplug(guest)


def test_damaged_frames_are_lost_in_the_driver(guest: Guest) -> None:
    def damage() -> None:
        for number in (1, 2, 3):  # one at a time: pending signals merge
            guest.sh("killall -USR1 v4l")
            guest.wait_until(f"grep -qx 'damaged {number}' /tmp/uvc", pause=0.05)
        camera.wait_for_frames(guest, 3)

    plug(guest)
    result = camera.run_grabber(guest, "", 2, damage)
    assert result.wrong == []
    assert missing(result.frames) == result.counters.lost_total >= 3
    assert "damaged 3 brightness" in unplug(guest)


def test_unplugged_and_plugged_in_again(guest: Guest) -> None:
    times: list[float] = []

    def replug() -> None:
        time.sleep(1)
        unplug(guest)
        time.sleep(2)
        times.append(plug(guest))
        camera.wait_for_frames(guest, 3)

    plug(guest)
    result = camera.run_grabber(guest, "", 2, replug)
    text = camera.said(guest)
    assert result.wrong == []
    assert "unplugged" in text[1] and "back after" in text[-1], text
    assert {line for line in text[2:-1]} <= {f"{NODE}: Permission denied"}, text  # until mdev has set the rights
    first = next(frame for frame in result.frames if frame.published / 1e9 > times[0] - 1)
    assert first.published / 1e9 < times[0] + SOON
    assert result.counters.lost["away"] > 10
    unplug(guest)


def test_brightness_is_set_and_its_range_checked(guest: Guest) -> None:
    plug(guest)
    camera.configure(guest, "")
    camera.wait_for_frames(guest, 3)
    guest.sh("ddxctl set video brightness=42")
    status, text = guest.shell().run("ddxctl set video brightness=43 2>&1")
    assert (status, text.strip()) == (2, "ddxctl: video: brightness: takes a whole number from 0 to 200 in steps of 2, "
                                         "not 43")
    assert "brightness 42" in unplug(guest)


def test_jpeg_pictures(guest: Guest, work: pathlib.Path) -> None:
    """JPEG frames are decoded; the recording shows each number in order."""
    plug(guest, "MJPG")
    camera.configure(guest, "")
    camera.wait_for_frames(guest, 3)
    guest.sh("/etc/init.d/S*ddxvideosave start; sleep 5")
    session.stop_recorder(guest)
    guest.sh(f"/etc/init.d/S*{GRABBER} stop")
    shown = camera.numbers(FileSystem(guest.snapshot()).take_only("", work / "jpeg.y4m"))
    assert len(shown) > 20 and None not in shown
    steps = [((after or 0) - (before or 0)) % FRAMES for before, after in zip(shown, shown[1:])]
    assert sum(step - 1 for step in steps) <= camera.stats(guest).lost_total
    unplug(guest)
