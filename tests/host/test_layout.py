# SPDX-License-Identifier: GPL-2.0-or-later
"""Pictures that are not 4:2:0: bit-exact if both sides support the layout, otherwise converted or refused."""
from __future__ import annotations

import json
import pathlib
import re

import numpy
import pytest
from numpy.typing import NDArray

from .log_rules import begin, only
from .programs import TOP, Compiler, Desk, lost, pictures, start_recorder, stop, wait_until
from .rtp_source import H264, Source, encode
from .stream import Stream, finish

pytestmark = pytest.mark.retry

Image = NDArray[numpy.uint8]
FILES = {"C422": "YUV422P", "C444": "YUV444P", "Cmono": "GREY8", "Cmono16": "GREY16"}
LAYOUTS = [*FILES.values(), "RGB24"]
FRAMES = 5
CAPTION = 12  # rows of text below each picture of a montage


def write_clip(path: pathlib.Path, tag: str, width: int, height: int, frames: int = FRAMES) -> list[bytes]:
    """Write a clip of random samples, which any conversion would change."""
    samples = {"C422": 2, "C444": 3, "Cmono": 1, "Cmono16": 2}[tag]
    random = numpy.random.default_rng(width)
    planes = [random.bytes(samples * width * height) for _ in range(frames)]
    header = b"YUV4MPEG2 W%d H%d F50:1 Ip %s\n" % (width, height, tag.encode())
    path.write_bytes(header + b"".join(b"FRAME\n" + plane for plane in planes))
    return planes


def write_bars(path: pathlib.Path, width: int = 64, height: int = 48) -> None:
    """Red, green and blue side by side, in C444."""
    colours = numpy.array([(81, 90, 240), (145, 54, 34), (41, 240, 110)], numpy.uint8)
    columns = colours[numpy.arange(width) * 3 // width]
    planes = numpy.repeat(columns.T[:, None, :], height, axis=1).tobytes()
    path.write_bytes(b"YUV4MPEG2 W%d H%d F25:1 Ip C444\nFRAME\n" % (width, height) + planes)


def load(desk: Desk, clip: pathlib.Path, layout: str, *options: object) -> None:
    done = desk.run("ddxvideoload", clip, "-layout", layout, *options)
    assert done.returncode == 0, done.stderr


@pytest.mark.strict
@pytest.mark.parametrize("tag", FILES)
def test_recordings_are_bit_exact(desk: Desk, tag: str) -> None:
    """Into the store and out again, to a file and to a pool with right checksums; C422 has an odd height, the others
    have two odd sides."""
    width = 34 if tag == "C422" else 33
    planes = write_clip(desk.folder / "clip.y4m", tag, width, 17)
    (desk.folder / "rec").mkdir()
    savers = [start_recorder(desk, "-output", "out.y4m", "-instance", "one"),
              start_recorder(desk, "-output", "rec", "-segment", 1, "-instance", "two")]
    load(desk, desk.folder / "clip.y4m", FILES[tag], "-readers", 2)
    for saver in savers:
        status, counters = stop(saver)
        assert status == 0 and counters["out"] == FRAMES and lost(counters) == 0
    assert pictures(desk.folder / "out.y4m") == planes
    assert f" {tag}".encode() in (desk.folder / "out.y4m").read_bytes().split(b"\n")[0] + b" "
    recorded, = (desk.folder / "rec").glob("*.y4m")
    assert pictures(recorded) == planes
    verified = desk.run("ddxrecordings", "verify", "-folder", "rec")
    assert verified.returncode == 0, verified.stdout + verified.stderr
    shown, = map(json.loads, desk.run("ddxrecordings", "list", "-json", "-folder", "rec").stdout.splitlines())
    assert shown["frames"] == FRAMES


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_paper_client_is_refused(desk: Desk, compile_client: Compiler, layout: str) -> None:
    write_bars(desk.folder / "clip.y4m")
    load(desk, desk.folder / "clip.y4m", layout)
    client = desk.run(compile_client("paper_client"))
    assert client.returncode == 3 and "another type" in client.stderr and not client.stdout
    shown = desk.run("ddxctl", "show", "video").stdout
    assert re.search(rf"^format +\d+ \({layout}\)$", shown, re.M)
    assert (re.search(r"^u +\[\]$", shown, re.M) is not None) == (layout in {"GREY8", "GREY16", "RGB24"})


def test_a_recorder_refuses_a_layout_without_a_y4m_tag(desk: Desk) -> None:
    write_bars(desk.folder / "clip.y4m")
    saver = start_recorder(desk, "-output", "out.y4m")
    load(desk, desk.folder / "clip.y4m", "RGB24", "-readers", 1)
    assert saver.wait(60) == 2
    said = [line for line in desk.errors(saver).splitlines() if "RGB24" in line]
    assert len(said) == 1 and "no Y4M file can hold" in said[0]
    assert not (desk.folder / "out.y4m").exists()
    wrong = desk.run("ddxvideoload", "clip.y4m", "-layout", "YUV411P")
    assert wrong.returncode == 2 and "YUV411P" in wrong.stderr and wrong.stderr.count("\n") == 1


def ppm(path: pathlib.Path) -> Image:
    magic, size, _, data = path.read_bytes().split(b"\n", 3)
    width, height = map(int, size.split())
    assert magic == b"P6"
    return numpy.frombuffer(data, numpy.uint8).reshape(height, width, 3)


def bars_of(image: Image, x: int = 0, width: int = 64) -> NDArray[numpy.int64]:
    """The colours in the middle of the three bars."""
    found: NDArray[numpy.int64] = image[24, x + numpy.array([width // 6, width // 2, width * 5 // 6])].astype(int)
    return found


def test_snap_and_montage(desk: Desk) -> None:
    colours, grey = numpy.eye(3) * 255, numpy.array([[76] * 3, [150] * 3, [29] * 3])
    write_bars(desk.folder / "clip.y4m")
    for layout in LAYOUTS:
        load(desk, desk.folder / "clip.y4m", layout, "-name", layout)
        assert desk.run("ddxvideosnap", "-name", layout, "one.ppm").returncode == 0
        found, right = bars_of(ppm(desk.folder / "one.ppm")), grey if "GREY" in layout else colours
        assert (abs(found - right) <= 3).all(), (layout, found)
    assert desk.run("ddxvideosnap", "-montage", "all.ppm").returncode == 0
    cells = ppm(desk.folder / "all.ppm")
    height = 48 + CAPTION
    assert cells.shape == (2 * height, 3 * 64, 3)
    for place, layout in enumerate(sorted(LAYOUTS)):
        cell = cells[place // 3 * height:, place % 3 * 64:][:48, :64]
        assert (abs(bars_of(cell) - (grey if "GREY" in layout else colours)) <= 3).all(), layout
    # RGB is not converted, in any size.
    with (desk.folder / "odd.y4m").open("wb") as file:
        file.write(b"YUV4MPEG2 W3 H1 F25:1 Cmono XCOLORRANGE=FULL\nFRAME\n\x03\x80\xfe")
    load(desk, desk.folder / "odd.y4m", "RGB24", "-name", "odd")
    assert desk.run("ddxvideosnap", "-name", "odd", "odd.ppm").returncode == 0
    assert ppm(desk.folder / "odd.ppm")[0, :, 1].tolist() == [3, 128, 254]


def wide_bars(stream: Stream) -> pathlib.Path:
    clip = stream.folder / "clip.y4m"
    write_bars(clip, 96, 64)
    return clip


@pytest.mark.parametrize("layout", LAYOUTS)
def test_sent_pictures_keep_their_colours(stream: Stream, layout: str) -> None:
    """ddxdecode's pictures have the colours of the item."""
    send = stream.send("-wire", 2000, "-codec", "mpeg4")
    decode = stream.decode()
    wait_until(lambda: stream.desk.item("video") is not None and send.poll() is None)
    load(stream.desk, wide_bars(stream), layout, "-readers", 1)
    wait_until(lambda: stream.desk.out("ddxdecode") > 0)
    assert stream.desk.run("ddxvideosnap", "-name", "seen", "seen.ppm").returncode == 0
    found = bars_of(ppm(stream.folder / "seen.ppm"), 0, 96)
    right = numpy.array([[76] * 3, [150] * 3, [29] * 3]) if "GREY" in layout else numpy.eye(3) * 255
    assert (abs(found - right) <= 24).all(), found
    finish(send, decode)


def test_too_small_to_be_sent(stream: Stream) -> None:
    (stream.folder / "dot.y4m").write_bytes(b"YUV4MPEG2 W1 H1 F25:1 Cmono\nFRAME\n\x80")
    send = stream.send()
    load(stream.desk, stream.folder / "dot.y4m", "GREY8", "-readers", 1)
    assert send.wait(60) == 2
    assert [line for line in stream.desk.errors(send).splitlines() if "1x1 cannot be sent" in line]


@pytest.mark.parametrize("pixels", ["yuv422p", "yuv444p", "yuvj444p"])
def test_decode_converts(stream: Stream, pixels: str) -> None:
    """A stream of another program, in its layout."""
    decode, source = stream.decode("-group", "none"), Source(stream.network, H264)
    frames = encode(H264, 3, "64x48", pixels)
    source.send(frames)
    wait_until(lambda: stream.desk.out("ddxdecode") == len(frames))
    assert stream.desk.run("ddxvideosnap", "-name", "seen", "seen.ppm").returncode == 0
    assert ppm(stream.folder / "seen.ppm").std() > 30
    finish(decode)


def test_a_log_and_its_replay_keep_the_layout(desk: Desk) -> None:
    """The replay has the same pictures, and a recorder accepts them."""
    planes = write_clip(desk.folder / "clip.y4m", "Cmono16", 33, 17)
    logger = begin(desk, "output first\nitem video\n")
    load(desk, desk.folder / "clip.y4m", "GREY16", "-readers", 1)
    wait_until(lambda: desk.out("ddxlog") == FRAMES)
    assert stop(logger)[0] == 0
    saver = start_recorder(desk, "-name", "again.video", "-output", "out.y4m")
    done = desk.run("ddxlog", "-replay", only(desk, "first"), "-prefix", "again.", "-readers", 1)
    assert done.returncode == 0, done.stderr
    status, counters = stop(saver)
    assert status == 0 and counters["out"] == FRAMES
    assert pictures(desk.folder / "out.y4m") == planes


def test_all_lists_of_layouts_are_equal() -> None:
    """ddxctl and Python name the layouts like common/video_layout.c."""
    table = (TOP / "package/ddxvideo/common/video_layout.c").read_text()
    names = re.findall(r'^    \{"(\w+)", DDX', table, re.M)
    header = (TOP / "package/ddxvideo/include/ddxvideo.h").read_text()
    numbers = {name: int(number) for name, number in re.findall(r"DDX_VIDEO_(\w+) = (\d+)", header)}
    assert names[0] == "YUV420P" and [numbers[name] for name in names[1:]] == [16, 17, 18, 19, 20]
    ctl = re.search(r"from_16\[\] = \{(.*?)\}", (TOP / "package/ddx/ddxctl/show.c").read_text())
    assert ctl and re.findall(r"\w+", ctl[1]) == names[1:]
    python = (TOP / "package/ddx/python/ddxvideo.py").read_text()
    assert re.findall(r'^    Layout\("(\w+)"', python, re.M) == names
    options = re.search(r'VIDEO_LAYOUT_NAMES "(.*?)"', (TOP / "package/ddxvideo/common/video_layout.h").read_text())
    assert options and re.findall(r"\w+\d\w*", options[1]) == names
