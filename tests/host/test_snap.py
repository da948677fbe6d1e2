# SPDX-License-Identifier: GPL-2.0-or-later
"""Single pictures: the file shows the frame's picture, as judged by FFmpeg."""
from __future__ import annotations

import pathlib
import re
import subprocess

import numpy
import pytest
from numpy.typing import NDArray

from lib.seen import read_text
from parts.media import clip as numbered_clip

from .programs import Desk, ffmpeg, make_clip

pytestmark = pytest.mark.retry

Image = NDArray[numpy.uint8]
CONVERSION = "scale=in_color_matrix=bt601:out_color_matrix=bt601:flags=bicubic+accurate_rnd+full_chroma_int"
# Largest mean difference of samples in a correct picture.
FORMATS = {"ppm": 1.0, "png": 1.0, "jpg": 4.0, "JPEG": 4.0}


def rgb(path: pathlib.Path, *options: str) -> Image:
    sides = subprocess.run(["ffprobe", "-v", "error", "-show_entries", "stream=width,height", "-of", "csv=p=0", path],
                           check=True, stdout=subprocess.PIPE, text=True).stdout
    width, height = map(int, sides.split(","))
    data = ffmpeg("-i", path, *options, "-frames:v", "1", "-f", "rawvideo", "-pix_fmt", "rgb24", "-")
    return numpy.frombuffer(data, numpy.uint8).reshape(height, width, 3)


def difference(a: Image, b: Image) -> float:
    assert a.shape == b.shape
    return float(numpy.mean(numpy.abs(a.astype(int) - b)))


def play(desk: Desk, clip: pathlib.Path, name: str = "video") -> None:
    done = desk.run("ddxvideoload", clip, "-rate", "0", "-name", name, "-instance", f"load.{name}")
    assert done.returncode == 0, done.stderr


def snap(desk: Desk, *arguments: object) -> None:
    done = desk.run("ddxvideosnap", *arguments)
    assert done.returncode == 0 and not done.stderr, done.stderr


@pytest.mark.parametrize("format", FORMATS)
def test_formats(desk: Desk, format: str) -> None:
    clip = make_clip(desk.folder / "clip.y4m", "320x240", "25", 3)
    play(desk, clip)
    picture = desk.folder / f"picture.{format}"
    snap(desk, picture)
    last = rgb(clip, "-vf", f"select=eq(n\\,2),{CONVERSION}")
    found = rgb(picture)
    assert difference(found, last) < FORMATS[format]
    # Proves that the check can fail: another frame, another matrix, swapped planes.
    first = rgb(clip, "-vf", f"select=eq(n\\,0),{CONVERSION}")
    assert difference(found, first) > FORMATS[format]
    assert difference(found[:, :, ::-1], last) > FORMATS[format]
    other = rgb(clip, "-vf", f"select=eq(n\\,2),{CONVERSION.replace('in_color_matrix=bt601', 'in_color_matrix=bt709')}")
    assert difference(other, last) > 1.0


def test_montage(desk: Desk) -> None:
    """Three items of different sizes; the number is read from each cell, and the caption from below it."""
    numbers = {"one": 7, "two": 123456, "wide": 42}
    for name, number in numbers.items():
        clip = desk.folder / f"{name}.y4m"
        width, height = (704, 288) if name == "wide" else (352, 288)
        plane = numpy.full((height, width), 90, numpy.uint8)
        numbered_clip.draw_number(plane, number)
        clip.write_bytes(b"YUV4MPEG2 W%d H%d F25:1 C420jpeg\nFRAME\n" % (width, height) + plane.tobytes() +
                         bytes([128]) * (width * height // 2))
        play(desk, clip, name)
    snap(desk, "-montage", desk.folder / "all.png")
    image = rgb(desk.folder / "all.png")
    line = 12  # rows of text
    second = 288 + line
    assert image.shape == (2 * second, 2 * 704, 3)
    gray = numpy.ascontiguousarray(image[:, :, 1])
    cells = {"one": gray[:288, 176:528], "two": gray[:288, 704 + 176:704 + 528],
             "wide": gray[second:second + 288, :704]}
    captions = {"one": image[289:, 176:528], "two": image[289:, 704 + 176:704 + 528], "wide": image[-line + 1:, :704]}
    for name, caption in captions.items():
        assert re.fullmatch(rf"{name}  frame 0  \d+\.\d\d s old", read_text(caption, 1))
    for name, cell in cells.items():
        found = numbered_clip.frame_number(cell.tobytes(), cell.shape[1], cell.shape[0])
        assert found == numbers[name]
    assert gray[:288, :176].max() == 0 and gray[second:, 704:].max() == 0  # black around the pictures
    # a missing item is shown as missing
    assert numbered_clip.frame_number(gray[second:second + 288, 704:].tobytes(), 704, 288) is None


def test_refusals(desk: Desk) -> None:
    nothing = desk.run("ddxvideosnap", "-montage", "all.png")
    assert nothing.returncode == 1 and nothing.stderr.count("\n") == 1
    missing = desk.run("ddxvideosnap", "x.png")
    assert missing.returncode == 1 and "video" in missing.stderr and missing.stderr.count("\n") == 1
    play(desk, make_clip(desk.folder / "clip.y4m", "64x48", "25", 1))
    nowhere = desk.run("ddxvideosnap", "/nonexistent/x.png")
    assert nowhere.returncode == 1 and "/nonexistent/x.png" in nowhere.stderr
    (desk.folder / "kept.ppm").write_bytes(b"old")
    (desk.folder / "kept.ppm.new").mkdir()
    assert desk.run("ddxvideosnap", "kept.ppm").returncode == 1
    assert (desk.folder / "kept.ppm").read_bytes() == b"old"
