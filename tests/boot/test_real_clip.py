# SPDX-License-Identifier: GPL-2.0-or-later
"""A real clip, larger than CIF: pedestrians, from OpenCV's examples in Debian."""
import pathlib

import pytest

from parts.guest import qemu, session, testdisk
from parts.media.footage import footage as make_footage

pytestmark = [pytest.mark.retry, pytest.mark.long]

FRAMES = 200
SLOWLY = 0.4


@pytest.fixture(scope="module")
def footage(work: pathlib.Path) -> pathlib.Path:
    return make_footage(work / "footage.y4m", FRAMES)


def test_real_footage_is_recorded_bit_exact(boot: qemu.Boot, work: pathlib.Path, footage: pathlib.Path) -> None:
    # Slowly, since an emulated machine copies little.
    disk = testdisk.make(work / "footage.img", footage, {"ddxvideoload.conf": f"rate={SLOWLY}\n"})
    with boot("footage", test_disk=disk, more_memory=testdisk.more_memory(footage)) as guest:
        guest.shell()
        session.wait_for_clip(guest, FRAMES, rate=25 * SLOWLY)
        session.stop_recorder(guest)
        result = session.collect(guest, footage, work / "footage-recorded.y4m")
    assert result.disagreements == []
    assert result.outside.exact and result.outside.recorded == FRAMES
    assert result.good
