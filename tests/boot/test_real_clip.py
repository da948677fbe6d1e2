# SPDX-License-Identifier: GPL-2.0-or-later
"""A clip that a camera made, larger than CIF: pedestrians, from OpenCV's examples in Debian."""
import pathlib

import pytest

import qemu
import session
import testdisk
from archive import Archive
from common import CACHE, run

FRAMES = 200
PATH = "./usr/share/doc/opencv-doc/examples/data/vtest.avi"


@pytest.fixture(scope="module")
def footage(work: pathlib.Path) -> pathlib.Path:
    avi = CACHE / "vtest.avi"
    if not avi.exists():
        package = Archive().package("opencv-doc")
        unpack = f'dpkg-deb --fsys-tarfile "$1" | tar -xO {PATH} > "$2.new" && mv "$2.new" "$2"'
        run(["sh", "-c", unpack, "sh", package, avi])
        package.unlink()
    clip = work / "footage.y4m"
    # its 10 frames a second at the pace of PAL
    run(["ffmpeg", "-v", "error", "-y", "-i", avi, "-vf", "setpts=N/25/TB", "-r", "25", "-frames:v", str(FRAMES),
         "-pix_fmt", "yuv420p", "-strict", "-1", clip])
    return clip


def test_real_footage_is_recorded_bit_exact(boot: qemu.Boot, work: pathlib.Path, footage: pathlib.Path) -> None:
    disk = testdisk.make(work / "footage.img", footage)
    with boot("footage", test_disk=disk, memory=testdisk.memory(footage)) as guest:
        guest.shell()
        session.wait_for_clip(guest, FRAMES)
        session.stop_recorder(guest)
        result = session.collect(guest, footage, work / "footage-recorded.y4m")
    assert result.disagreements == []
    assert result.outside.exact and result.outside.recorded == FRAMES
    assert result.good
