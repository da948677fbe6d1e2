# SPDX-License-Identifier: GPL-2.0-or-later
"""A FireWire bus with IIDC cameras: the kernel's firewire-core, libdc1394 and ddxvideo1394 are real; a module for the
development image's kernel simulates the card and the cameras."""
import contextlib
import dataclasses
import functools
import time
from collections.abc import Iterator

import pytest

from lib import firewire
from parts.guest import machine
from parts.guest.machine import Machine
from parts.guest.qemu import Guest
from parts.media.counters import Counters

from . import camera

pytestmark = pytest.mark.strict

CAMERAS = 5
SECOND = 8000  # bus cycles
ROOM = 8  # frames that a reader may lag behind
GRABBER = "ddxvideo1394"


@dataclasses.dataclass
class Captured:
    numbers: list[int]
    cycles: list[int]  # since the first frame
    wrong: list[int]   # wrong bytes in each frame
    damaged: list[int]
    resets: int


@pytest.fixture(scope="module")
def guest(bus_guest: Guest, board: Machine) -> Iterator[Guest]:
    if board.board != machine.DEV:
        pytest.skip("the module is built for the development image's kernel alone")
    firewire.load(bus_guest, CAMERAS)
    yield bus_guest
    bus_guest.sh(f"[ ! -e {firewire.CONTROL} ] || rmmod {firewire.NAME}")  # other tests find only their own cameras


def parse(text: str) -> Captured:
    *frames, last = [[int(word) for word in line.split()] for line in text.splitlines()]
    numbers, cycles, wrong, damaged = (list(column) for column in zip(*frames))
    return Captured(numbers, cycles, wrong, damaged, (last[1] - last[0]) % 256)


def planned(numbers: list[int], rate: float) -> list[int]:
    """The cycles, from frame 0 on, at which the frames with these numbers begin."""
    return [int(number * SECOND / rate) for number in numbers]


@contextlib.contextmanager
def plan(guest: Guest, which: int, **frames: tuple[int, int]) -> Iterator[None]:
    """Plan faults: (first frame, count), where frames are counted from the start of the transmission."""
    for what, (first, count) in frames.items():
        firewire.command(guest, f"{what} {which} {first} {count}")
    try:
        yield
    finally:
        for what in frames:
            firewire.command(guest, f"{what} {which} 0 0")


def test_the_cameras_are_found(guest: Guest) -> None:
    lines = guest.sh(f"{firewire.PROGRAM} list").splitlines()
    assert sorted(lines) == [f"00b09d0100abcde{number} ACME CAM{number}" for number in range(CAMERAS)]


def test_losses_are_gaps_in_the_bus_time(guest: Guest) -> None:
    """Also around a bus reset, after which requests reach the camera again. A frame with a missing packet takes one
    packet from the next frame, which is then lost."""
    with plan(guest, 2, lose=(6, 3), reset=(12, 1), tear=(15, 1)):
        captured = parse(guest.sh(f"{firewire.PROGRAM} capture 2 30 24 2> /dev/null"))
    assert captured.numbers == [0, 1, 2, 3, 4, 5, 9, 10, 11, 12, 13, 14, 15, *range(17, 28)]
    assert [number for number, wrong in zip(captured.numbers, captured.wrong) if wrong] == [15]
    assert [number for number, damaged in zip(captured.numbers, captured.damaged) if damaged] == [15]
    assert captured.cycles == planned(captured.numbers, 30)
    assert captured.resets == 1


def test_a_damaged_frame_of_many_packets(guest: Guest) -> None:
    """Of 960 packets, whose headers the kernel reports in two events."""
    with plan(guest, 3, tear=(2, 1)):
        captured = parse(guest.sh(f"{firewire.PROGRAM} capture 3 7.5 5 2> /dev/null"))
    assert captured.numbers == [0, 1, 2, 4, 5] and captured.damaged == [0, 0, 1, 0, 0]
    assert captured.cycles == planned(captured.numbers, 7.5)


def test_captures_release_channel_and_bandwidth(guest: Guest) -> None:
    """The bus has room for three captures."""
    assert guest.sh(f"{firewire.PROGRAM} repeat 4 6 2>&1") == ""


def test_five_cameras_on_one_bus(guest: Guest) -> None:
    capture = f"{firewire.PROGRAM} capture $camera 15 8 > /tmp/camera.$camera 2> /dev/null"
    guest.sh(f"for camera in 0 1 2 3 4; do {capture} & done; wait")
    for camera in range(CAMERAS):
        captured = parse(guest.sh(f"cat /tmp/camera.{camera}"))
        assert captured.numbers == list(range(8))
        assert captured.cycles == planned(captured.numbers, 15) and not any(captured.wrong)


def test_unplugged_and_plugged_in_again(guest: Guest) -> None:
    firewire.command(guest, "plug 1 0")
    firewire.wait_for_devices(guest, CAMERAS)
    assert "CAM1" not in guest.sh(f"{firewire.PROGRAM} list")
    firewire.command(guest, "plug 1 1")
    firewire.wait_for_devices(guest, CAMERAS + 1)
    assert parse(guest.sh(f"{firewire.PROGRAM} capture 1 30 4 2> /dev/null")).numbers == list(range(4))


@functools.cache
def checksum(which: int, number: int, width: int = firewire.WIDTH, height: int = firewire.HEIGHT) -> int:
    """The checksum of the camera's grey picture in the store."""
    grey = firewire.picture(which, number, width * height)
    return camera.checksum(grey + bytes([128]) * (len(grey) // 2), width, height)


def instance_of(which: int) -> str:
    return f"{GRABBER}.cam{which}"


def start(guest: Guest, which: int, rate: float = 15, mode: str = "mode=640x480_MONO8") -> None:
    guest.sh(f"ddxctl add {instance_of(which)} camera={firewire.GUID.format(which)} name=cam{which} {mode} rate={rate}")


def stop(guest: Guest, which: int) -> Counters:
    """Stop the grabber and return its counters."""
    guest.sh(f"ddxctl stop {instance_of(which)}")
    counters = camera.stats(guest, instance_of(which))
    guest.sh(f"ddxctl remove {instance_of(which)}")
    return counters


def said(guest: Guest, which: int) -> list[str]:
    """The grabber's messages without times and counters."""
    text = [line.split(" ", 1)[1] for line in camera.log(guest, instance_of(which)).splitlines() if " " in line]
    name = f"{GRABBER}: camera {firewire.GUID.format(which)}: "
    return [line.removeprefix(name) for line in text if not line.startswith("{")]


def judge(which: int, frames: list[camera.Frame], first: int = 0) -> None:
    """Check that each frame's number is the one in its pixels plus `first`, the frames before the camera was last
    switched on: so each loss is counted exactly once."""
    numbers = [frame.number for frame in frames]
    assert numbers == sorted(set(numbers))
    assert [frame.checksum for frame in frames] == [checksum(which, number - first) for number in numbers]


def test_the_grabber_lists_cameras_and_modes(guest: Guest) -> None:
    lines = guest.sh(f"{GRABBER} -list").splitlines()
    assert lines[0] == f"0: {firewire.GUID.format(0)} ACME CAM0"
    assert "  640x480_MONO8: 7.5 15 30 fps" in lines
    assert len([line for line in lines if "ACME CAM" in line]) == CAMERAS


def test_the_grabber_counts_each_loss(guest: Guest) -> None:
    """Around a bus reset, exactly the planned frames are missing, and those that a slow machine lost."""
    with plan(guest, 2, lose=(20, 3), reset=(28, 1), tear=(32, 1)):
        reader = camera.Reader(guest, 60, "cam2")
        start(guest, 2)
        camera.wait_for_frames(guest, 40, instance_of(2))
        counters = stop(guest, 2)
        frames = reader.stop()
    judge(2, frames)
    missing = set(range(frames[-1].number)) - {frame.number for frame in frames}
    assert missing >= {20, 21, 22, 32, 33} and 28 not in missing
    assert counters.frames_in == counters.out + counters.lost_total == frames[-1].number + 1
    assert counters.lost["error"] == 1 and counters.lost_total == counters.lost["driver"] + 1
    before = frames[0].number - frames[0].source_lost  # frames before the reader's first one
    assert counters.out == before + len(frames) + sum(frame.missed for frame in frames[1:])
    assert len(said(guest, 2)) == 2, said(guest, 2)  # one about the camera, one about lost frames


def test_a_part_of_the_picture_in_format7(guest: Guest) -> None:
    """Losses are counted by the rate, which follows from the packets: 8000 a second, 768 of 100 bytes per frame."""
    with plan(guest, 4, lose=(9, 3)):
        reader = camera.Reader(guest, 60, "cam4")
        start(guest, 4, 10, "mode=FORMAT7_0 format=MONO8 roi=64,32,320,240")
        camera.wait_for_frames(guest, 16, instance_of(4))
        counters, frames = stop(guest, 4), reader.stop()
    assert [frame.checksum for frame in frames] == [checksum(4, frame.number, 320, 240) for frame in frames]
    assert not {9, 10, 11} & {frame.number for frame in frames}
    assert counters.frames_in == counters.out + counters.lost_total == frames[-1].number + 1
    item = camera.value(guest, "cam4")
    assert (item["width"], item["height"], item["rate_num"], item["rate_den"]) == (320, 240, 125, 12)


@pytest.mark.long
def test_the_grabber_finds_a_camera_again_by_its_guid(guest: Guest) -> None:
    """Another camera goes on without a break."""
    start(guest, 0)
    start(guest, 1)
    for which in (0, 1):
        camera.wait_for_frames(guest, 3, instance_of(which))
    readers = [camera.Reader(guest, 60, f"cam{which}") for which in (0, 1)]
    firewire.command(guest, "plug 1 0")
    guest.wait_until(f"grep -q 'waiting for' /run/log/{instance_of(1)}/current", pause=0.1)
    firewire.command(guest, "plug 0 0")  # changes the node numbers of the other cameras
    firewire.command(guest, "plug 1 1")
    for which in (1, 0):
        guest.wait_until(f"grep -q 'back after' /run/log/{instance_of(which)}/current", 30, pause=0.1)
        camera.wait_for_frames(guest, 3, instance_of(which), 30)
        firewire.command(guest, "plug 0 1")
    for which, reader in enumerate(readers):
        counters, frames = stop(guest, which), reader.stop()
        begin = next(index for index, frame in enumerate(frames) if frame.checksum != checksum(which, frame.number))
        judge(which, frames[:begin])
        number = next(number for number in range(20) if checksum(which, number) == frames[begin].checksum)
        judge(which, frames[begin:], frames[begin].number - number)  # a camera counts from 0 when it is switched on
        assert counters.frames_in == counters.out + counters.lost_total and counters.lost["away"] > 0
        assert "waiting for" in said(guest, which)[1] and "back after" in said(guest, which)[-1]


def begins(which: int, frames: list[camera.Frame]) -> list[int]:
    """The number of the camera's frame 0 for each time that it was switched on: a slow machine takes it for silent
    and switches it on again. In between, each frame's number is the one in its pixels, as in judge()."""
    first: list[int] = []
    for frame in frames:
        if not first or checksum(which, frame.number - first[-1]) != frame.checksum:
            picture = next(number for number in range(frame.number + 1) if checksum(which, number) == frame.checksum)
            first.append(frame.number - picture)
    assert first == sorted(first)
    return first


@pytest.mark.long
def test_five_grabbers_on_one_bus(guest: Guest) -> None:
    readers = [camera.Reader(guest, 600, f"cam{which}", ROOM) for which in range(CAMERAS)]
    for which in range(CAMERAS):
        start(guest, which, 7.5)
    for which in range(CAMERAS):
        camera.wait_for_frames(guest, 20, instance_of(which))
    guest.sh("; ".join(f"ddxctl stop {instance_of(which)}" for which in range(CAMERAS)))
    for which, reader in enumerate(readers):
        counters, frames, lines = stop(guest, which), reader.stop(), said(guest, which)
        again = sum("back after" in line for line in lines)
        assert len(frames) >= 10 and len(begins(which, frames)) <= 1 + again
        assert again or begins(which, frames) == [0]
        assert counters.frames_in == counters.out + counters.lost_total and counters.lost["store"] == 0, lines
        assert counters.frames_in == frames[-1].number + 1 or counters.lost["away"], lines  # perhaps lost at the end


@pytest.mark.long
def test_a_camera_that_does_not_answer_is_reported_in_one_line(guest: Guest) -> None:
    firewire.command(guest, "silent 3 1")
    start(guest, 3)
    guest.wait_until(f"grep -q 'does not answer' /run/log/{instance_of(3)}/current", 30, pause=0.1)
    time.sleep(7)  # a grabber that hangs is killed after 6 s
    firewire.command(guest, "silent 3 0")
    camera.wait_for_frames(guest, 3, instance_of(3))
    lines = [line for line in said(guest, 3) if "libdc1394" not in line]
    assert lines[0] == "in use by another program, or does not answer" and len(lines) == 2, lines
    assert "restarts=0" in guest.sh(f"ddxctl status {instance_of(3)}")
    stop(guest, 3)


def test_the_module_can_be_removed_completely(guest: Guest) -> None:
    firewire.unload(guest)
    assert guest.sh("ls /dev | grep -c '^fw' || true").strip() == "0"
    assert "Oops" not in guest.sh("dmesg") and "WARNING" not in guest.sh("dmesg")
