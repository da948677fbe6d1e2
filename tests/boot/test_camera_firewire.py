# SPDX-License-Identifier: GPL-2.0-or-later
"""A FireWire bus with IIDC cameras: the kernel's firewire-core and libdc1394 are real, the card and the cameras are a
module. It is made for the development image's kernel."""
import dataclasses
import pathlib
from collections.abc import Iterator

import pytest

from parts.guest import firewire, machine, qemu, testdisk
from parts.guest.machine import Machine
from parts.guest.qemu import Guest

CAMERAS = 5
SECOND = 8000  # bus cycles


@dataclasses.dataclass
class Captured:
    numbers: list[int]
    cycles: list[int]  # since the first frame
    wrong: list[int]   # bytes of each
    resets: int


@pytest.fixture(scope="module")
def guest(boot: qemu.Boot, work: pathlib.Path, board: Machine) -> Iterator[Guest]:
    if board.board != machine.DEV:
        pytest.skip("the module is built for the development image's kernel alone")
    disk = testdisk.make(work / "firewire.img", None, firewire.files(work))
    with boot("camera-firewire", test_disk=disk) as running:
        running.shell()
        firewire.load(running, CAMERAS)
        yield running


def parse(text: str) -> Captured:
    *frames, last = [[int(word) for word in line.split()] for line in text.splitlines()]
    numbers, cycles, wrong = (list(column) for column in zip(*frames))
    return Captured(numbers, cycles, wrong, (last[1] - last[0]) % 256)


def planned(numbers: list[int], rate: int) -> list[int]:
    """When frames of these numbers begin, in cycles since frame 0."""
    return [number * SECOND // rate for number in numbers]


def test_the_cameras_are_found(guest: Guest) -> None:
    lines = guest.sh(f"{firewire.PROGRAM} list").splitlines()
    assert sorted(lines) == [f"00b09d0100abcde{number} ACME CAM{number}" for number in range(CAMERAS)]


def test_losses_are_gaps_in_the_bus_time(guest: Guest) -> None:
    """Also around a bus reset, after which requests reach the camera again. A frame that lacks a packet takes one of
    the next frame, which is lost then."""
    for text in ("lose 2 6 3", "reset 2 12 1", "tear 2 15 1"):
        firewire.command(guest, text)
    captured = parse(guest.sh(f"{firewire.PROGRAM} capture 2 30 24 2> /dev/null"))
    for text in ("lose 2 0 0", "reset 2 0 0", "tear 2 0 0"):
        firewire.command(guest, text)
    assert captured.numbers == [0, 1, 2, 3, 4, 5, 9, 10, 11, 12, 13, 14, 15, *range(17, 28)]
    assert [number for number, wrong in zip(captured.numbers, captured.wrong) if wrong] == [15]
    assert captured.cycles == planned(captured.numbers, 30)
    assert captured.resets == 1


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


def test_the_module_leaves_nothing(guest: Guest) -> None:
    firewire.unload(guest)
    assert guest.sh("ls /dev | grep -c '^fw' || true").strip() == "0"
    assert "Oops" not in guest.sh("dmesg") and "WARNING" not in guest.sh("dmesg")
