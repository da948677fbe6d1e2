# SPDX-License-Identifier: GPL-2.0-or-later
"""Guests for the boot tests: the development image as flashed, on throw-away copies."""
import pathlib
from collections.abc import Iterator

import pytest

import build
import clip as default_clip
import native
import qemu
import session
import testdisk
from common import OUTPUT

WORK = OUTPUT / "test"


@pytest.fixture(scope="session")
def work() -> pathlib.Path:
    WORK.mkdir(parents=True, exist_ok=True)
    return WORK


@pytest.fixture(scope="session")
def image() -> pathlib.Path:
    return build.dev([native.build()])


@pytest.fixture(scope="session")
def root(image: pathlib.Path) -> pathlib.Path:
    """The image's root file system, unpacked, as it was packed."""
    return image.parent / "root"


@pytest.fixture(scope="session")
def accel(image: pathlib.Path) -> str:
    return qemu.acceleration(image)


@pytest.fixture(scope="session")
def clip(work: pathlib.Path) -> pathlib.Path:
    """20 s of numbered frames."""
    path = OUTPUT / "clip.y4m"
    if not path.exists():
        default_clip.write(path)
    return path


@pytest.fixture(scope="session")
def guest(image: pathlib.Path, accel: str, work: pathlib.Path, clip: pathlib.Path) -> Iterator[qemu.Guest]:
    """A guest that records the clip, with a shell."""
    disk = testdisk.make(work / "clip.img", clip)
    with qemu.Guest(image, accel, test_disk=disk, log=work / "guest.log") as running:
        running.shell()
        yield running


@pytest.fixture(scope="session")
def closed(image: pathlib.Path, accel: str, work: pathlib.Path) -> Iterator[qemu.Guest]:
    """A guest exactly as flashed: nothing provisioned, no test disk. Its slot is on trial, as after an update."""
    with qemu.Guest(image, accel, console=False, environment=("left=3",), log=work / "closed.log") as running:
        yield running


@pytest.fixture(scope="session")
def recorded(guest: qemu.Guest, clip: pathlib.Path, work: pathlib.Path) -> session.Result:
    """The clip has gone through, and the recording was compared with it."""
    session.wait_for_clip(guest, default_clip.SECONDS * default_clip.RATE)
    session.stop_recorder(guest)
    result = session.collect(guest, clip, work / "recorded.y4m")
    guest.sh("mount -o remount,rw /rec && /etc/init.d/S*ddxvideosave start")
    return result
