# SPDX-License-Identifier: GPL-2.0-or-later
"""The boot's work that the first frame does not need comes after it."""
from __future__ import annotations

import os
import pathlib
from collections.abc import Iterator

import pytest

from .appliance import Appliance
from .programs import wait_until

pytestmark = pytest.mark.retry

LATE, ALIASES = "/usr/libexec/ddx/late", "/usr/libexec/ddx/aliases.awk"
JOBS = ["lastboot", "settings-copy save", "grow"]


@pytest.fixture
def appliance(tmp_path: pathlib.Path) -> Iterator[Appliance]:
    """A machine whose jobs only write their names; its recordings' disk is mounted."""
    appliance = Appliance(tmp_path)
    appliance.install("overlay/usr/libexec/ddx/late", LATE[1:])
    appliance.install("overlay/usr/libexec/ddx/aliases.awk", ALIASES[1:])
    for name in ("lastboot", "settings-copy", "grow"):
        appliance.add(f"usr/libexec/ddx/{name}", '#!/bin/sh\necho ${0##*/} "$@" >> /run/order\n')
    appliance.add("usr/libexec/ddx/own-partition", "#!/bin/sh\necho /dev/sda$1\n")
    (appliance.root / "rec").mkdir()
    assert appliance.run("mkfifo /run/late && mount -t tmpfs /dev/sda6 /rec")[0] == 0
    yield appliance
    appliance.end()


def done(appliance: Appliance) -> list[str]:
    """The jobs in order, once all are done."""
    wait_until((appliance.root / "run/late.done").exists)
    assert float((appliance.root / "run/late.begun").read_text()) > 0
    return (appliance.root / "run/order").read_text().splitlines()


def open_pipe(path: pathlib.Path) -> int:
    """Open the pipe for writing, once it has a reader."""
    found: list[int] = []

    def is_read() -> bool:
        try:
            found.append(os.open(path, os.O_WRONLY | os.O_NONBLOCK))
        except OSError:
            return False
        return True
    wait_until(is_read)
    return found[0]


def test_the_work_begins_with_the_first_frame(appliance: Appliance) -> None:
    appliance.start(LATE)
    pipe = open_pipe(appliance.root / "run/late")
    with (appliance.root / "run/order").open("a") as order:
        order.write("frame\n")
    os.write(pipe, b"\n\n")  # a second byte changes nothing
    assert done(appliance) == ["frame", *JOBS]
    os.close(pipe)


def test_without_a_camera_the_work_begins_after_ten_seconds(appliance: Appliance) -> None:
    appliance.start(LATE)
    assert done(appliance) == JOBS


def test_rescue_does_not_wait_and_grows_nothing(appliance: Appliance) -> None:
    appliance.run("umount /rec; rm /run/late; echo root=/dev/sda2 ddx.rescue > /run/words; "
                  "mount --bind /run/words /proc/cmdline")
    appliance.start(LATE)
    assert done(appliance) == JOBS[:2]
    assert not (appliance.root / "run/late").exists()  # it has not been opened


def test_drivers_of_the_first_frame_are_loaded_first_and_those_of_displays_later(appliance: Appliance) -> None:
    """Aliases of a display, a network card, a USB camera, a watchdog, a keyboard's bus, FireWire, virtio's display, a
    frame grabber and a USB controller, the last one twice."""
    display, other = "pci:v00001234d00001111sv00001AF4sd00001100bc03sc00i00", "acpi:PNP0303:"
    wanted = ["usb:v046Dp0825d0012dcEFdsc02dp01ic0Eisc01ip00in00", "pci:v0000109Ed0000036Esv0sd0bc04sc00i00",
              "pci:v00001B36d0000000Dsv00001AF4sd00001100bc0Csc03i30", "pci:v0000104Cd00008024sv0sd0bc0Csc00i10",
              "pci:v00008086d000025ABsv00001AF4sd00001100bc08sc80i00",
              "pci:v00001AF4d00001000sv00001AF4sd00000001bc02sc00i00"]
    given = [display, wanted[5], wanted[0], wanted[4], other, wanted[3], "virtio:d00000010v00001AF4", wanted[1],
             wanted[2], wanted[2]]
    appliance.add("run/aliases", "\n".join(given) + "\n")
    assert appliance.run(f"awk -f {ALIASES} < /run/aliases") == (0, "\n".join([*wanted, other]) + "\n")
    assert appliance.run(f"awk -v displays=1 -f {ALIASES} < /run/aliases") == (0, f"{given[0]}\n{given[6]}\n")
