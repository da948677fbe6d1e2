# SPDX-License-Identifier: GPL-2.0-or-later
"""Calibrations and clips of stereo pairs, and their results."""
from __future__ import annotations

import json
import pathlib
from collections.abc import Iterable, Sequence
from typing import Any

import numpy

from lib import calibration
from lib.calibration import Matrices
from parts.common import Failed
from parts.media import stereo_pairs
from parts.media.stereo_pairs import Grey, Map, Pair

from .absent import not_made
from .programs import Counters, Desk, Process, pictures, start_recorder, stop, wait_for_recorder, wait_until

SVS = "ddxvideoSVS"


def write_calibration(path: pathlib.Path, matrices: Matrices, size: tuple[int, int] | None = None) -> pathlib.Path:
    path.write_text(calibration.text(matrices, size))
    return path


def found(make: str, *arguments: object) -> Any:
    """One of the pairs."""
    try:
        return getattr(stereo_pairs, make)(*arguments)
    except Failed as error:
        not_made("no stereo pictures to test with", error)


def write_clip(path: pathlib.Path, stacked: Iterable[Grey], fields: int = 2, levels: str = "FULL") -> pathlib.Path:
    """Write a clip of grey pictures at 25 Hz."""
    pictures = list(stacked)
    height, width = pictures[0].shape
    header = f"YUV4MPEG2 W{width} H{height} F25:1 Ip Cmono XDDX_FIELDS={fields} XCOLORRANGE={levels}\n"
    path.write_bytes(header.encode() + b"".join(b"FRAME\n" + picture.tobytes() for picture in pictures))
    return path


def start(desk: Desk, file: pathlib.Path, *options: object) -> Process:
    process = desk.start(SVS, "-calib", file, *options)
    wait_until(lambda: process.poll() is not None or desk.item(f"{SVS}.stats") != {})
    return process


def settled(desk: Desk, frames: int) -> Counters:
    """Wait until that number of frames came in and none is waiting; return the counters."""
    def look() -> bool:
        counters = desk.stats(SVS)
        return bool(counters["in"] >= frames and counters["waiting"] == 0)

    wait_until(look)
    return desk.stats(SVS)


def check_sum(counters: Counters) -> None:
    assert counters["in"] == counters["out"] + sum(counters["lost"].values()) and not counters["waiting"], counters


def run_clip(desk: Desk, stacked: list[Grey], matrices: Matrices, disparities: int, options: Sequence[object] = (),
             load: Sequence[object] = (), levels: str = "FULL") -> dict[str, Any]:
    """Run the program on stacked pictures; records range.y4m and disparity.y4m, returns item range.stereo."""
    rows, width = stacked[0].shape
    clip = write_clip(desk.folder / "clip.y4m", stacked, levels=levels)
    file = write_calibration(desk.folder / "stereo.yml", matrices, (width, rows // 2))
    range_saver = start_recorder(desk, "-name", "range", "-output", "range.y4m", "-instance", "range")
    saver = start_recorder(desk, "-name", "range.disparity", "-output", "disparity.y4m", "-instance", "disparity")
    for instance in ("range", "disparity"):
        wait_for_recorder(desk, instance)
    process = start(desk, file, "-disparities", disparities, *options)
    loader = desk.run("ddxvideoload", clip, "-layout", "GREY8", "-readers", 1, *load)
    assert loader.returncode == 0, loader.stderr
    settled(desk, len(stacked))
    stereo = json.loads(desk.run("ddxctl", "show", "--json", "range.stereo").stdout or "{}")
    status, counters = stop(process)
    assert status == 0 and counters["in"] == len(stacked) and counters["lost"]["picture"] == 0, desk.errors(process)
    check_sum(counters)
    for recorder in (range_saver, saver):
        status, saved = stop(recorder)
        assert status == 0 and saved["out"] == counters["out"] > 0
    return dict(stereo)


def disparities_in(file: pathlib.Path, height: int, width: int) -> list[Map]:
    """The disparities of each frame, in pixels."""
    return [numpy.frombuffer(picture, "<u2").reshape(height, width).astype(numpy.float32) / numpy.float32(16)
            for picture in pictures(file)]


def ranged(desk: Desk, pair: Pair, *options: object, top: str = "left",
           matrices: Matrices | None = None) -> tuple[list[bytes], Map, dict[str, Any]]:
    """Run the program on a clip of this pair; return the range pictures, the last disparities, and the values needed to
    calculate metres."""
    height, width = pair.left.shape
    eyes = [pair.left, pair.right] if top == "left" else [pair.right, pair.left]
    stereo = run_clip(desk, [numpy.vstack(eyes)] * 3, matrices or calibration.ideal(width, height), pair.disparities,
                      ["-top", top, *options])
    return pictures(desk.folder / "range.y4m"), disparities_in(desk.folder / "disparity.y4m", height, width)[-1], stereo
