# SPDX-License-Identifier: GPL-2.0-or-later
"""A camera's controls are listed, followed, and changed on request; judged by the driver's own values."""
import re
import time
from typing import Any

import pytest

from parts.guest.qemu import Guest

from . import camera
from .camera import GRABBER

pytestmark = pytest.mark.retry


@pytest.fixture(scope="module")
def guest(camera_guest: Guest) -> Guest:
    camera.configure(camera_guest, "input=Webcam size=320x180 rate=25")  # each input has its own controls
    camera.wait_for_frames(camera_guest, 5)
    return camera_guest


def parameters(guest: Guest) -> dict[str, dict[str, Any]]:
    shown = camera.value(guest, "video.parameters")
    return {one["name"]: one for one in shown["parameter"][:shown["count"]]}


def ask(guest: Guest, words: str) -> tuple[int, str]:
    status, text = guest.shell().run(f"ddxctl set video {words} 2>&1")
    return status, text.strip()


def our_name(name: str) -> str:
    return re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")


def test_each_control_of_the_driver_is_listed_with_its_value(guest: Guest) -> None:
    ours, theirs = parameters(guest), camera.driver_controls(guest)
    moving = {"gain", "read_only_integer_32_bits"}  # vivid changes these with time
    assert {our_name(name) for name in theirs} <= set(ours)
    assert len(theirs) > 30
    for name, value in theirs.items():
        assert our_name(name) in moving or ours[our_name(name)]["value"] == value, name
    brightness = ours["brightness"]
    assert (brightness["minimum"], brightness["maximum"], brightness["step"], brightness["initial"]) == (0, 255, 1, 128)


def test_a_request_changes_the_driver(guest: Guest) -> None:
    assert ask(guest, "brightness=77 contrast=5") == (0, "")
    theirs, ours = camera.driver_controls(guest), parameters(guest)
    assert theirs["Brightness"] == ours["brightness"]["value"] == 77
    assert theirs["Contrast"] == ours["contrast"]["value"] == 5


@pytest.mark.parametrize("words, status, text", [
    ("brightness=256", 2, "brightness: takes a whole number from 0 to 255, not 256"),
    ("brightness=-1", 2, "brightness: takes a whole number from 0 to 255, not -1"),
    ("contrast=9 brightness=4000000000", 2, "brightness: takes a whole number from 0 to 255, not 4000000000"),
    ("colour=1", 2, "colour: no such parameter"),
    ("read_only_integer_32_bits=1", 2, "read_only_integer_32_bits: cannot be changed now"),
    ("bitmask=0x100000000", 2, "bitmask: takes the bits of 0x80402010, not 4294967296"),
])
def test_refused_with_the_allowed_range(guest: Guest, words: str, status: int, text: str) -> None:
    before = camera.driver_controls(guest)
    assert ask(guest, words) == (status, f"ddxctl: video: {text}")
    after = camera.driver_controls(guest)
    moving = {"Gain": 0, "Read-Only Integer 32 Bits": 0}
    assert {**before, **moving} == {**after, **moving}


def test_parameters_follow_changes_by_other_programs(guest: Guest) -> None:
    for value in (10, 200):
        camera.control(guest, f"Saturation={value}")
        time.sleep(0.5)
        assert parameters(guest)["saturation"]["value"] == value


def test_requested_values_survive_a_replug(guest: Guest) -> None:
    assert ask(guest, "hue=-33") == (0, "")
    guest.sh("echo vivid.0 > /sys/bus/platform/drivers/vivid/unbind; sleep 1")
    status, text = ask(guest, "hue=5")
    assert status == 1 and text.startswith("ddxctl: video: the camera is not there now")
    guest.sh("echo vivid.0 > /sys/bus/platform/drivers/vivid/bind")
    camera.wait_for_frames(guest, 5)
    assert camera.driver_controls(guest)["Hue"] == parameters(guest)["hue"]["value"] == -33


def test_requests_lose_no_frame(guest: Guest) -> None:
    def ask_often() -> None:
        for value in range(20):
            assert ask(guest, f"brightness={value}") == (0, "")

    run = camera.run_grabber(guest, "input=Webcam size=320x180 rate=25", 2, ask_often)
    assert run.wrong == [] and camera.gaps(run.frames) == run.counters.lost_total


def test_a_request_without_a_running_grabber_is_refused(guest: Guest) -> None:
    guest.sh(f"/etc/init.d/S*{GRABBER} stop")
    status, said = ask(guest, "brightness=1")
    assert status == 2 and said.startswith("ddxctl: video: brightness: no such field; there are frame, fields, width,")
