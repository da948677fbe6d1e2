# SPDX-License-Identifier: GPL-2.0-or-later
"""Every pixel format, size and standard; two cameras; a stereo pair in the two fields of one. All with vivid."""
import pathlib
from collections.abc import Iterator

import numpy
import pytest

from parts.guest import qemu
from parts.guest.machine import Machine
from parts.guest.qemu import Guest
from parts.media import clip as default_clip
from parts.media.clip import HEIGHT, WIDTH, picture

from . import camera
from .camera import GRABBER, Reader

pytestmark = [pytest.mark.strict, pytest.mark.long]

SHOWN_MS, FRAMES = 200, 25
ROOM = 8  # frames of any size that a reader may lag behind
STORE = 128  # MiB; the image's setting is too small for 1080p
FIRST, SECOND = "/dev/video0", "/dev/video2"
PAL, WEBCAM = "input=S-Video standard=PAL skip=3", "input=Webcam rate=10 skip=3"
GREY = bytes([128]) * (WIDTH * HEIGHT // 2)


@pytest.fixture(scope="module")
def guest(boot: qemu.Boot, work: pathlib.Path, board: Machine) -> Iterator[Guest]:
    clip = work / "second.y4m"
    default_clip.write(clip, 1)
    disk = camera.disk(work, board.board, clip, {"ddxstore.conf": f"m={STORE}M\n"})
    with boot("camera-formats", test_disk=disk, more_memory=128 + 2 * STORE) as running:
        camera.prepare(running)
        running.sh("/etc/init.d/S*ddxvideosave stop")
        camera.vivid(running, "n_devs=2 node_types=0x101,0x101")  # each only a camera and an output
        yield running


@pytest.fixture(scope="module")
def pictures() -> list[bytes]:
    return [picture(number) for number in range(FRAMES)]


def looped(guest: Guest, settings: str, fourcc: str) -> list[camera.Frame]:
    """The frames captured while the clip is shown."""
    camera.configure(guest, f"input=S-Video standard=PAL size=CIF {settings}")
    camera.wait_for_frames(guest)
    camera.loop(guest, SHOWN_MS, fourcc)
    camera.wait_for_frames(guest, 10)  # the new signal has been noticed
    reader = Reader(guest, 60)
    guest.sh("sleep 1; touch /tmp/feed/go")
    guest.wait_until("grep -q shown /tmp/feed/log")
    frames = reader.stop()
    guest.sh("touch /tmp/feed/end")
    guest.wait_until("! pidof v4l > /dev/null")
    return frames


@pytest.mark.parametrize("fourcc", ["YU12", "NV12", "YUYV", "UYVY", "GREY"])
def test_each_format_comes_out_bit_exact(guest: Guest, pictures: list[bytes], fourcc: str) -> None:
    wanted = [one[:WIDTH * HEIGHT] + GREY if fourcc == "GREY" else one for one in pictures]
    frames = looped(guest, f"format={fourcc}", fourcc)
    assert camera.shows(frames, camera.checksums(wanted, WIDTH, HEIGHT))


def planes_in(layout: str, clip: bytes) -> list[bytes]:
    """A picture of the clip in this layout, as the output shows it: rows of chroma alternate between the fields."""
    luma, half = WIDTH * HEIGHT, WIDTH // 2
    if layout == "GREY8":
        return [clip[:luma]]
    planes = [numpy.frombuffer(clip[begin:begin + luma // 4], numpy.uint8).reshape(-1, half)
              for begin in (luma, luma // 4 * 5)]
    rows = [row // 4 * 2 + row % 2 for row in range(HEIGHT)]
    return [clip[:luma], *(bytes(plane[rows].tobytes()) for plane in planes)]


@pytest.mark.parametrize("fourcc, layout", [("YUYV", "YUV422P"), ("UYVY", "YUV422P"), ("GREY", "GREY8"),
                                            ("YUYV", "GREY8")])
def test_a_layout_of_the_same_samples_is_bit_exact(guest: Guest, pictures: list[bytes], fourcc: str,
                                                   layout: str) -> None:
    wanted = [camera.checksum_of_planes(planes_in(layout, one)) for one in pictures]
    assert camera.shows(looped(guest, f"format={fourcc} layout={layout}", fourcc), wanted)


@pytest.mark.parametrize("layout, number, taken", [
    ("YUV422P", 16, "YUYV"), ("GREY8", 18, "GREY"), ("GREY16", 19, "Y16"), ("RGB24", 20, "RGB24")])
def test_a_camera_format_without_conversion_is_preferred(guest: Guest, layout: str, number: int, taken: str) -> None:
    camera.configure(guest, f"input=Webcam size=320x180 layout={layout}")
    camera.wait_for_frames(guest, 3)
    assert camera.value(guest, "video")["format"] == number
    assert f" {taken} 320x180, to video 320x180" in camera.said(guest)[0]


def test_readers_that_block_a_new_layout_are_reported(guest: Guest) -> None:
    camera.configure(guest, "input=Webcam size=320x180")
    camera.wait_for_frames(guest, 3)
    reader = Reader(guest, 60)
    camera.configure(guest, "input=Webcam size=320x180 layout=GREY8")
    guest.wait_until("grep -q 'its readers have it open in a layout other than GREY8' /run/log/ddxvideoV4L/current")
    reader.stop()
    camera.wait_for_frames(guest, 3)
    assert camera.stats(guest).lost["store"] > 0
    assert camera.value(guest, "video")["format"] == 18


def test_an_interlaced_pair_is_stacked(guest: Guest, pictures: list[bytes]) -> None:
    def stacked(plane: bytes, width: int) -> bytes:
        rows = numpy.frombuffer(plane, numpy.uint8).reshape(-1, width)
        return bytes(numpy.concatenate([rows[0::2], rows[1::2]]).tobytes())

    luma, chroma = WIDTH * HEIGHT, WIDTH * HEIGHT // 4
    wanted = [stacked(one[:luma], WIDTH) + stacked(one[luma:luma + chroma], WIDTH // 2)
              + stacked(one[luma + chroma:], WIDTH // 2) for one in pictures]
    frames = looped(guest, "format=YU12 deinterlace=stack", "YU12")
    assert camera.shows(frames, camera.checksums(wanted, WIDTH, HEIGHT))
    assert not camera.shows(frames, camera.checksums(pictures, WIDTH, HEIGHT))  # proves that the check can fail
    assert {frame.fields for frame in frames} == {2}


@pytest.mark.parametrize("name, width, height, where", [
    ("QCIF", 176, 144, PAL), ("4CIF", 704, 576, PAL), ("VGA", 640, 480, PAL), ("PAL", 720, 576, PAL),
    ("200x100", 200, 100, PAL), ("720p", 1280, 720, WEBCAM), ("1080p", 1920, 1080, WEBCAM)])
def test_each_size(guest: Guest, name: str, width: int, height: int, where: str) -> None:
    run = camera.run_grabber(guest, f"{where} size={name}", 1, keep=ROOM)
    assert run.wrong == [] and {(frame.width, frame.height) for frame in run.frames} == {(width, height)}


def test_standards_and_their_rates(guest: Guest) -> None:
    for standard, height, rate in [("NTSC", 480, (30000, 1001)), ("PAL", 576, (25, 1))]:
        camera.configure(guest, f"input=S-Video standard={standard}")
        camera.wait_for_frames(guest, 5)
        video = camera.value(guest, "video")
        assert (video["width"], video["height"]) == (720, height)
        assert (video["rate_num"], video["rate_den"]) == rate
        assert chr(video["interlacing"]) == ("t" if standard == "PAL" else "b")


def test_a_change_of_the_signal_is_followed(guest: Guest) -> None:
    """Without -standard, the grabber takes the standard of the signal."""
    camera.configure(guest, "input=S-Video")
    camera.wait_for_frames(guest, 5)
    reader = Reader(guest, 60, keep=ROOM)
    camera.control(guest, "Standard=NTSC-M")
    camera.control(guest, "Standard Signal Mode=Selected Standard")
    camera.wait_for_frames(guest, 40)
    camera.control(guest, "Standard=PAL-B")
    camera.control(guest, "Standard Signal Mode=Current Standard")
    camera.control(guest, "Standard Signal Mode=Selected Standard")
    camera.wait_for_frames(guest, 40)
    camera.control(guest, "Standard Signal Mode=Current Standard")
    frames = reader.stop()
    heights = [frame.height for frame in frames]
    seen = [height for index, height in enumerate(heights) if index == 0 or height != heights[index - 1]]
    assert seen == [576, 480, 576]
    for before, after in zip(frames, frames[1:]):
        assert (after.published - before.published) / 1e9 < 2


def test_two_cameras_are_two_instances(guest: Guest) -> None:
    right = f"{GRABBER}.right"
    guest.sh(f"printf '%s\\n' camera=2 name=right size=320x180 rate=25 > /data/ddx/{right}.conf")
    try:
        camera.configure(guest, "camera=0 name=left size=320x180 rate=25")
        camera.wait_for_frames(guest, 5)
        camera.wait_for_frames(guest, 5, right)
        readers = [Reader(guest, 30, name) for name in ("left", "right")]
        camera.wait_for_frames(guest, 50)
        camera.control(guest, "Percentage of Dropped Buffers=50", SECOND)
        camera.wait_for_frames(guest, 50)
        camera.control(guest, "Percentage of Dropped Buffers=0", SECOND)
        left, right_frames = [reader.stop() for reader in readers]
        guest.sh(f"/etc/init.d/S*{GRABBER} stop")
        assert len(left) > 90 and camera.gaps(right_frames) > 10 + camera.gaps(left)
        status = guest.shell().run(f"/etc/init.d/S*{GRABBER} status")[1]
        assert f"{right} enabled=yes" in status
        assert camera.stats(guest, right).lost["driver"] >= camera.gaps(right_frames)
    finally:
        guest.sh(f"rm /data/ddx/{right}.conf")
