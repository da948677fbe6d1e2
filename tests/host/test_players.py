# SPDX-License-Identifier: GPL-2.0-or-later
"""Common players open a recording and find every frame."""
from __future__ import annotations

import pathlib
import subprocess

import pytest

from .programs import Desk, ffmpeg, header_of, make_clip, pictures, record

pytestmark = pytest.mark.retry

FRAMES = 20
# "long": the longest likely header, with large numbers and all our parameters.
HEADERS = {"plain": "F25:1 Ip A1:1 C420jpeg",
           "long": "F30000:1001 It A128:117 C420mpeg2 XDDX_FIELDS=12 XCOLORRANGE=LIMITED"}


@pytest.fixture(params=HEADERS)
def recording(desk: Desk, request: pytest.FixtureRequest) -> pathlib.Path:
    clip, out = make_clip(desk.folder / "clip.y4m", "352x288", "25", FRAMES), desk.folder / "out.y4m"
    data = clip.read_bytes()
    clip.write_bytes(f"YUV4MPEG2 W352 H288 {HEADERS[request.param]}\n".encode() + data[data.index(b"\n") + 1:])
    record(desk, clip, out, "-rate", "4")
    assert len(pictures(out)) == FRAMES
    return out


def test_ffmpeg(recording: pathlib.Path) -> None:
    assert ffmpeg("-i", recording, "-fps_mode", "passthrough", "-f", "rawvideo", "-") == b"".join(pictures(recording))


def test_gstreamer(recording: pathlib.Path) -> None:
    raw = recording.with_suffix(".raw")
    subprocess.run(["gst-launch-1.0", "-q", "filesrc", f"location={recording}", "!", "y4mdec", "!", "filesink",
                    f"location={raw}"], check=True, timeout=60)
    assert raw.read_bytes() == b"".join(pictures(recording))


def test_gstreamer_detects_the_format(recording: pathlib.Path) -> None:
    raw = recording.with_suffix(".raw")
    subprocess.run(["gst-launch-1.0", "-q", "filesrc", f"location={recording}", "!", "decodebin", "!", "filesink",
                    f"location={raw}"], check=True, timeout=60)
    assert raw.read_bytes() == b"".join(pictures(recording))


def test_mjpegtools(recording: pathlib.Path) -> None:
    """yuvfps at the file's own rate copies every frame."""
    rate = next(word[1:] for word in header_of(recording).split() if word.startswith("F"))
    copy = recording.with_suffix(".copy.y4m")
    with open(recording, "rb") as source, open(copy, "wb") as target:
        subprocess.run(["yuvfps", "-v", "0", "-s", rate, "-r", rate], stdin=source, stdout=target, check=True,
                       timeout=60)
    assert pictures(copy) == pictures(recording)


def test_mjpegtools_to_pictures(recording: pathlib.Path) -> None:
    """y4mtopnm -f: one grey picture for each frame, luma above chroma."""
    with open(recording, "rb") as source:
        pgm = subprocess.run(["y4mtopnm", "-f"], stdin=source, check=True, timeout=60, capture_output=True).stdout
    luma = pictures(recording)
    count = 0
    while pgm:
        magic, sides, pgm = pgm.split(b"\n", 2)
        width, height, depth = map(int, sides.split())
        assert (magic, width, depth) == (b"P5", 352, 255)
        assert pgm[:352 * 288] == luma[count][:352 * 288]
        pgm = pgm[width * height:]
        count += 1
    assert count == FRAMES
