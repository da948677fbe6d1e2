# SPDX-License-Identifier: GPL-2.0-or-later
"""A FireWire bus inside a guest: a module with a card and IIDC cameras, and a program that captures from them."""
import pathlib

from parts.common import TOP, run
from parts.guest.qemu import Guest
from parts.image import module, rootfs

SOURCES = TOP / "tests/guest/firewire"
NAME = "vfirewire"
CONTROL = f"/sys/module/{NAME}/parameters/do"
FOLDER = "/tmp/firewire"  # nothing runs from the test disk itself
PROGRAM = f"LD_LIBRARY_PATH={FOLDER} {FOLDER}/firewire"
IN_IMAGE = ("libc.so", "libm.so", "ld-linux")


def files(work: pathlib.Path) -> dict[str, pathlib.Path | str]:
    """For a test disk: the module, the program, and the libraries that the image does not have."""
    program = work / "firewire"
    run(["gcc", "-std=gnu11", "-O2", "-Wall", "-Wextra", "-Werror", SOURCES / "capture.c", "-o", program, "-ldc1394"])
    libraries = [path for path in rootfs.libraries(program, []) if not path.name.startswith(IN_IMAGE)]
    return {f"{NAME}.ko": module.module(SOURCES / "module", NAME), program.name: program,
            **{path.name: path.resolve() for path in libraries}}


def load(guest: Guest, cameras: int) -> None:
    """Until firewire-core has a device for each camera, and one for the card."""
    guest.sh(f"mkdir {FOLDER} && cp /test/firewire /test/*.so.* {FOLDER} && chmod 755 {FOLDER}/firewire")
    guest.sh(f"modprobe firewire-core && insmod /test/{NAME}.ko cameras={cameras}")
    wait_for_devices(guest, cameras + 1)


def wait_for_devices(guest: Guest, count: int) -> None:
    guest.wait_until(f"[ $(ls /dev/fw* | wc -l) = {count} ]", pause=0.1)


def command(guest: Guest, text: str) -> None:
    guest.sh(f"echo {text} > {CONTROL}")


def unload(guest: Guest) -> None:
    guest.sh(f"rmmod {NAME}")
