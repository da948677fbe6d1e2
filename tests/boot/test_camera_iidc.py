# SPDX-License-Identifier: GPL-2.0-or-later
"""An IIDC camera on USB: usbfs, libusb and libdc1394 are real; a program simulates the camera."""
from collections.abc import Iterator

import pytest

from parts.guest.qemu import Guest

from . import camera, iidc
from .iidc import CODINGS, FRAMES, Camera, Grabber, expected, wrong

pytestmark = pytest.mark.strict


@pytest.fixture(scope="module")
def guest(bus_guest: Guest) -> Guest:
    return bus_guest


@pytest.fixture
def plugged(guest: Guest) -> Iterator[Camera]:
    one = Camera(guest)
    one.plug()
    yield one
    one.unplug()


def test_each_coding_comes_out_bit_exact(guest: Guest, plugged: Camera) -> None:
    for coding in CODINGS:
        grabber = Grabber(guest, f"-camera {iidc.GUID} -format {coding}", coding)
        grabber.wait(FRAMES)
        run = grabber.stop()
        assert wrong(run, expected(coding, True), counted=coding not in iidc.TWO_BYTES) == [], (coding, run.said)


def test_a_layout_with_the_camera_s_own_samples_is_bit_exact(guest: Guest, plugged: Camera) -> None:
    for layout, coding in iidc.LAYOUTS.items():
        grabber = Grabber(guest, f"-format {coding} -layout {layout}", layout)
        grabber.wait(3)
        run = grabber.stop()
        pictures = [camera.checksum_of_planes(iidc.in_layout(layout, number)) for number in range(FRAMES)]
        assert wrong(run, pictures) == [], (layout, run.said)


def test_missing_and_damaged_frames_are_counted(guest: Guest, plugged: Camera) -> None:
    """Two short frames, and three times three that were never sent: counted exactly, by the camera's counter."""
    grabber = Grabber(guest, "-format MONO8", "faults")
    grabber.wait(FRAMES)
    plugged.command("short", 2)
    plugged.command("skip", 3)
    grabber.wait_for_more()
    run = grabber.stop()
    assert wrong(run, expected("MONO8", True)) == []
    assert run.counters.lost["error"] == 2
    assert run.counters.lost["driver"] == run.frames[-1].source_lost
    assert run.frames[-1].source_lost - run.frames[0].source_lost == camera.gaps(run.frames) - 2 >= 9


def test_a_stall_and_a_replug(guest: Guest, plugged: Camera) -> None:
    """The stream starts again with its settings; while the camera is away, losses are counted by the clock."""
    grabber = Grabber(guest, "-format MONO8", "again")
    grabber.wait(FRAMES)
    guest.sh("ddxctl set again brightness=42 white_balance_red=17")
    plugged.command("stall")
    grabber.wait_said("starting it again")
    grabber.wait_for_more()
    assert plugged.unplug().endswith("brightness 42")
    grabber.wait_said("unplugged")
    plugged.plug()
    grabber.wait_for_more()
    run = grabber.stop()
    assert wrong(run, expected("MONO8", True)) == []
    assert run.counters.lost["away"] > 3 and sum("back after" in line for line in run.said) == 2
    value = {one["name"]: one["value"] for one in camera.value(guest, "again.parameters")["parameter"]}
    assert (value["brightness"], value["white_balance_red"]) == (42, 17)


def test_a_feature_and_its_range(guest: Guest, plugged: Camera) -> None:
    grabber = Grabber(guest, "-format MONO8", "set")
    grabber.wait(FRAMES)
    guest.sh("ddxctl set set brightness_auto=1")
    guest.sh("ddxctl set set brightness=200")  # ends automatic mode
    status, text = guest.shell().run("ddxctl set set brightness=236 2>&1")
    assert (status, text.strip()) == (2, "ddxctl: set: brightness: takes a whole number from 16 to 235, not 236")
    found = {one["name"]: one for one in camera.value(guest, "set.parameters")["parameter"] if one["name"]}
    assert {name: one["value"] for name, one in found.items()} == {
        "brightness": 200, "brightness_auto": 0, "brightness_one_push": 0, "brightness_on": 1, "white_balance_auto": 1,
        "white_balance_blue": 40, "white_balance_red": 60}
    assert (found["brightness"]["minimum"], found["brightness"]["maximum"]) == (16, 235)
    grabber.stop()


SILENT = "not found, but a camera that is plugged in does not answer: plug it in again"


def states(run: iidc.Run) -> list[str]:
    """The messages about the camera's state, without those about lost frames."""
    lines = [line.split(": ", 1) for line in run.said if "the driver lost" not in line]
    return [state for name, state in lines if name.startswith("camera ")]


def test_a_camera_that_never_answers(guest: Guest, plugged: Camera) -> None:
    """The program keeps looking, and takes a camera once it answers. Each state is reported in one line."""
    plugged.command("silent")
    grabber = Grabber(guest, "-format MONO8", "silent")
    grabber.wait_said("does not answer")
    plugged.command("answer")
    grabber.wait(FRAMES)
    run = grabber.stop()
    assert wrong(run, expected("MONO8", True)) == []
    assert [line.split(",")[0] for line in states(run)] == ["not found", "Test Cam"]


def test_a_silent_camera_is_not_called_unplugged(guest: Guest, plugged: Camera) -> None:
    grabber = Grabber(guest, "-format MONO8", "mute")
    grabber.wait(FRAMES)
    plugged.command("silent")
    plugged.command("stall")
    grabber.wait_said("does not answer")
    plugged.command("answer")
    grabber.wait_for_more()
    run = grabber.stop()
    assert wrong(run, expected("MONO8", True)) == []
    assert states(run)[1:-1] == ["the stream broke off, starting it again", SILENT]
    assert "back after" in states(run)[-1]
