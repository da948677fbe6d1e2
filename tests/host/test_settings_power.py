# SPDX-License-Identifier: GPL-2.0-or-later
"""Power cuts at any write of a toggle: the image's scripts on the host's kernel, with a disk whose writes are logged.
tests/boot/test_settings_power.py does it in the emulated machine, with more kinds of lost writes."""
from __future__ import annotations

import pathlib
from collections.abc import Iterator

import pytest

import build
from lib.settings_cut import TOGGLES, cuts, toggle, wrong
from parts.common import run
from parts.disk import blocklog
from parts.disk.logged_device import LoggedDevice, lacking
from parts.guest.native_machine import NativeMachine
from parts.guest.slow_disk import FILE_SYSTEMS
from parts.image import native

pytestmark = pytest.mark.retry

SIZE = 24 << 20  # bytes; several groups, so there is a second superblock, as in the appliance


@pytest.fixture
def image(tmp_path: pathlib.Path) -> pathlib.Path:
    """The disk's contents: a file system for settings."""
    path = tmp_path / "data.img"
    run(["truncate", "-s", str(SIZE), path])
    run(["mke2fs", "-q", "-b", "1024", *FILE_SYSTEMS["ext4-journal"], "-m", "0", "-L", "DDXDATA", path])
    return path


@pytest.fixture
def disk(image: pathlib.Path) -> Iterator[LoggedDevice]:
    if reason := lacking():
        pytest.skip(reason)
    with LoggedDevice(image) as disk:
        yield disk


@pytest.mark.parametrize("naive", [False, True], ids=["ddxctl", "naive"])
def test_settings_survive_a_power_cut_at_any_write(image: pathlib.Path, disk: LoggedDevice, tmp_path: pathlib.Path,
                                                   naive: bool) -> None:
    before, keep = image.read_bytes()[:SIZE], tmp_path / "keep"
    (keep / "data").mkdir(parents=True)
    run(["mount", "-o", "noatime", disk.device, keep / "data"])
    try:
        with NativeMachine(build.dev([native.build()]).parent / "root", keep) as robot:
            toggle(robot.sh, disk.mark, naive)
    finally:
        run(["umount", keep / "data"])
    disk.end()
    found = cuts(disk.log, blocklog.LoggedDisk(0, before), tmp_path / "cut.ext4", 1)
    assert len(found) > 4 * 3 * 2
    assert {done for done, _ in found} >= set(range(len(TOGGLES)))
    assert bool(wrong(found)) is naive, wrong(found)[:5]
