# SPDX-License-Identifier: GPL-2.0-or-later
"""A FireWire bus inside a guest: a module with a card and IIDC cameras, and a program that captures from them."""
import functools
import pathlib

from lib import module
from parts.common import TOP, run
from parts.guest.qemu import Guest
from parts.image import dc1394, srtp

SOURCES = TOP / "tests/guest/firewire"
NAME = "vfirewire"
CONTROL = f"/sys/module/{NAME}/parameters/do"
PROGRAM = "/tmp/firewire"  # programs do not run from the test disk
GUID = "00b09d0100abcde{}"
WIDTH, HEIGHT = 640, 480


def files(work: pathlib.Path) -> dict[str, pathlib.Path | str]:
    """Files for a test disk: the module, and the program with the product's patched libdc1394."""
    program, library = work / "firewire", dc1394.dc1394()
    run(["gcc", "-std=gnu11", "-O2", "-Wall", "-Wextra", "-Werror", f"-I{library}/usr/include",
         SOURCES / "capture.c", "-o", program, library / srtp.LIBRARIES / "libdc1394.a",
         "-lusb-1.0", "-lm"])  # libusb is in the image, for ddxvideo1394
    return {f"{NAME}.ko": module.module(SOURCES / "module", NAME), program.name: program}


@functools.cache
def _pixels(size: int) -> bytes:
    return bytes(place + (place >> 8) & 0xff for place in range(size))


def picture(camera: int, number: int, size: int = WIDTH * HEIGHT) -> bytes:
    """The grey values of a camera's frame, as module/iso.c makes it."""
    more = number * 7 + camera * 31
    pixels = _pixels(size).translate(bytes(value + more & 0xff for value in range(256)))
    return number.to_bytes(4, "big") + pixels[4:]


def load(guest: Guest, cameras: int) -> None:
    """Load the module; wait until firewire-core has a device for each camera and one for the card."""
    guest.sh(f"cp /test/firewire {PROGRAM} && chmod 755 {PROGRAM}")
    guest.sh(f"modprobe firewire-core && insmod /test/{NAME}.ko cameras={cameras}")
    wait_for_devices(guest, cameras + 1)


def wait_for_devices(guest: Guest, count: int) -> None:
    guest.wait_until(f"[ $(ls /dev/fw* | wc -l) = {count} ]", pause=0.1)


def command(guest: Guest, text: str) -> None:
    guest.sh(f"echo {text} > {CONTROL}")


def unload(guest: Guest) -> None:
    guest.sh(f"rmmod {NAME}")
