# SPDX-License-Identifier: GPL-2.0-or-later
"""ddxvideoplay on other graphics cards: for an hour, beside another program, and with the monitor unplugged."""
import pathlib
import time
from collections.abc import Callable, Iterator

import pytest

from parts.guest import machine, qemu, testdisk
from parts.guest.qemu import Guest

from .conftest import BOARD
from .test_screen import (ITEM, PLAY, console_of, load, number, sample, start, view, wait_for_alarm, wait_for_frame,
                          watch)

pytestmark = [pytest.mark.retry, pytest.mark.long]

DUMPS, SECONDS = 500, 900
HOUR = 6      # times --seconds, which is ten minutes by default
LOOK = 20     # s between samples
GROWTH = 256  # KiB
CONNECTOR = "/sys/class/drm/card0-Virtual-1/status"


def ready(guest: Guest, driver: str) -> None:
    """Prepare a guest whose screen has this driver, with the clip played in a loop."""
    guest.shell()
    guest.sh("for name in ddxvideosave ddxvideoload; do /etc/init.d/S*$name stop; done; true")
    guest.wait_until(f"grep -q DRIVER={driver} /sys/class/drm/card0/device/uevent")
    load(guest, "/test/clip.y4m -loop")


@pytest.fixture(scope="module")
def virtio(boot: qemu.Boot, work: pathlib.Path, short_clip: pathlib.Path) -> Iterator[Guest]:
    disk = testdisk.make(work / "virtio.img", short_clip)
    with boot("virtio", test_disk=disk, extra=("-vga", "none", "-device", "virtio-gpu-pci")) as guest:
        ready(guest, "virtio")
        yield guest


def test_virtio(virtio: Guest) -> None:
    start(virtio)
    watch(virtio, DUMPS, SECONDS)


def test_an_hour_without_growth(virtio: Guest, pytestconfig: pytest.Config,
                                record_property: Callable[[str, object], None]) -> None:
    """After the first quarter, memory and open files do not grow, and each sample shows newer frames. The frame rate is
    low enough for an emulated processor. The number of files is the least of a quarter."""
    virtio.sh(f"kill $(cat /tmp/{ITEM}.pid)")
    load(virtio, "/test/clip.y4m -loop -rate 0.1")
    shown = start(virtio)
    look = f"pid=$(pidof {PLAY}) && grep RssAnon /proc/$pid/status && ls /proc/$pid/fd | wc -l"
    looks: list[tuple[int, int]] = []  # KiB of memory, open files
    end = time.monotonic() + HOUR * int(pytestconfig.getoption("seconds"))
    while time.monotonic() < end:
        shown = wait_for_frame(virtio, number(sample(shown)))
        words = virtio.sh(look).split()
        looks.append((int(words[1]), int(words[-1])))
        time.sleep(LOOK)
    quarter = len(looks) // 4
    record_property("KiB, files", [looks[quarter], looks[-1]])
    assert max(kib for kib, _ in looks[quarter:]) - looks[quarter][0] <= GROWTH
    assert min(files for _, files in looks[-quarter:]) <= min(files for _, files in looks[quarter:2 * quarter])


def test_a_monitor_that_is_unplugged(virtio: Guest) -> None:
    """The connector is forced off and on again."""
    before = start(virtio)
    virtio.sh(f"echo off > {CONNECTOR}")
    virtio.wait_until(f"grep -q 'the monitor is unplugged; trying again' /run/log/{PLAY}/current", pause=0.1)
    virtio.wait_until(f"grep -q 'no monitor; trying again' /run/log/{PLAY}/current", pause=0.1)
    virtio.sh(f"echo on > {CONNECTOR}")
    wait_for_frame(virtio, number(sample(before)))
    assert wait_for_alarm(virtio, "").shape == before.shape
    watch(virtio, 5)


def test_two_programs_on_one_screen(virtio: Guest) -> None:
    """The second one reports once that the screen is in use, and takes it after the first exits; so does a viewer."""
    start(virtio)
    virtio.sh(f"chpst -u ddxplay:ddx {PLAY} -name {ITEM} -instance second > /tmp/second 2>&1 & "
              "echo $! > /tmp/second.pid")
    virtio.wait_until("grep -q 'in use by another program' /tmp/second", pause=0.1)
    assert virtio.shell().run(f"ddxvideoview -name {ITEM} > /tmp/view.log 2>&1")[0] == 1
    virtio.sh("grep 'no display: .*in use by another program' /tmp/view.log")
    watch(virtio, 5)
    virtio.sh(f"/etc/init.d/S*{PLAY} stop")
    virtio.wait_until("grep -q 'shown at' /tmp/second", pause=0.1)
    wait_for_frame(virtio, None)
    watch(virtio, 5)
    assert virtio.sh("grep -c 'in use' /tmp/second") == "1"
    virtio.sh("kill $(cat /tmp/second.pid); while kill -0 $(cat /tmp/second.pid) 2> /dev/null; do sleep 0.02; done")
    virtio.sh(f"ddxvideoview -name {ITEM} > /tmp/view.log 2>&1 & echo $! > /tmp/view.pid")
    view(virtio, lambda seen: seen.label == "LIVE")
    virtio.sh("kill $(cat /tmp/view.pid); while kill -0 $(cat /tmp/view.pid) 2> /dev/null; do sleep 0.02; done")


@pytest.mark.skipif(BOARD == machine.DEV, reason="Debian's kernel has no simpledrm")
def test_the_mode_set_by_the_firmware(boot: qemu.Boot, work: pathlib.Path, short_clip: pathlib.Path) -> None:
    """A card without a kernel driver: simpledrm shows pictures in the mode set by UEFI, or by GRUB with a BIOS."""
    disk = testdisk.make(work / "simple.img", short_clip)
    with boot("simple", test_disk=disk, screen=True, extra=("-vga", "qxl")) as guest:
        ready(guest, "simple-framebuffer")
        console = console_of(guest)
        shown = start(guest)
        assert shown.shape == console.shape
        for _ in range(10):
            shown = wait_for_frame(guest, number(sample(shown)))
        guest.sh(f"sv once /run/service/{PLAY}; pid=$(cat /run/service/{PLAY}/supervise/pid); kill -KILL $pid; "
                 f"while kill -0 $pid 2> /dev/null; do sleep 0.02; done")
        assert console.any() and (console_of(guest) == console).all()


@pytest.mark.skipif(BOARD == machine.DEV, reason="Debian's kernel has no simpledrm")
def test_without_screen_on_there_is_no_screen(boot: qemu.Boot, board: machine.Machine) -> None:
    if board.firmware != "bios":
        pytest.skip("UEFI sets a mode")
    with boot("text", extra=("-vga", "qxl")) as guest:
        guest.shell()
        guest.sh("[ ! -e /dev/dri/card0 ] && [ ! -e /dev/fb0 ]")
        assert guest.shell().run(f"timeout 2 {PLAY} > /tmp/play 2>&1")[0] in (0, 124, 143)
        guest.sh("grep 'no screen: no driver has made /dev/dri/card0; trying again' /tmp/play")
