# SPDX-License-Identifier: GPL-2.0-or-later
"""ddxvideoV4L with vivid, the kernel's test camera: pictures from its looped output are recorded bit-exact."""
import pathlib

import pytest

from parts.common import PATIENCE
from parts.guest import session
from parts.guest.qemu import Guest
from parts.media import y4m
from parts.media.recording import FileSystem

from . import camera

pytestmark = pytest.mark.strict

SECONDS = 1  # of the clip: 25 frames
SHOWN_MS = 200


@pytest.fixture(scope="module")
def guest(camera_guest: Guest) -> Guest:
    camera.configure(camera_guest, "input=S-Video standard=PAL size=CIF format=YU12")
    camera.wait_for_frames(camera_guest)
    return camera_guest


@pytest.fixture
def clip(guest: Guest, work: pathlib.Path) -> pathlib.Path:
    return work / "feed.y4m"


def record(guest: Guest, work: pathlib.Path, name: str, shown: int) -> pathlib.Path:
    """Record while the clip is shown."""
    guest.sh("mount -o remount,rw /rec; rm -f /rec/*.y4m; /etc/init.d/S*ddxvideosave start")
    session.wait_for_recording(guest)
    guest.sh("touch /tmp/feed/go")
    guest.wait_until("grep -q shown /tmp/feed/log", PATIENCE + shown)
    session.stop_recorder(guest)
    guest.sh("touch /tmp/feed/end")
    return FileSystem(guest.snapshot()).take_only("", work / name)


def pictures(path: pathlib.Path) -> list[bytes]:
    return [frame.data for frame in y4m.read(path)[1]]


def test_a_camera_that_is_plugged_in_gives_frames(guest: Guest) -> None:
    assert camera.wait_for_frames(guest, 5).out >= 5


def test_looped_clip_comes_out_bit_exact(guest: Guest, clip: pathlib.Path, work: pathlib.Path) -> None:
    camera.loop(guest, SHOWN_MS)
    recorded = pictures(record(guest, work, "looped.y4m", SECONDS * 25 * SHOWN_MS // 1000))
    shown = pictures(clip)
    changes = [picture for index, picture in enumerate(recorded) if index == 0 or picture != recorded[index - 1]]
    due = iter(shown)
    assert all(picture in due for picture in changes)  # the clip's pictures, bit-exact, in order
    assert len(changes) >= len(shown) // 2  # pictures pass unseen if the host stalls


def test_text_in_the_picture_is_noticed(guest: Guest, clip: pathlib.Path, work: pathlib.Path) -> None:
    """Proves that the check can fail: the driver writes text into the same loop."""
    camera.loop(guest, SHOWN_MS)
    camera.control(guest, "OSD Text Mode=Counters Only")
    recorded = pictures(record(guest, work, "spoilt.y4m", SECONDS * 25 * SHOWN_MS // 1000))
    assert recorded and not set(recorded) & set(pictures(clip))
    camera.control(guest, "OSD Text Mode=None")
