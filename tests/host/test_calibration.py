# SPDX-License-Identifier: GPL-2.0-or-later
"""Unusable calibrations are refused in one line, before anything is written; rectification equals OpenCV's."""
from __future__ import annotations

import pathlib
from collections.abc import Callable

import numpy
import pytest

from lib.calibration import Matrices, ideal
from parts.media.stereo_pairs import Pair

from .absent import module
from .programs import Desk, stop, wait_until
from .stereo_rules import SVS, check_sum, ranged, settled, start, write_calibration, write_clip
from .test_options import run

pytestmark = pytest.mark.retry

WIDTH, HEIGHT = 64, 16


def changed(name: str, row: int, column: int, value: float) -> Matrices:
    matrices = ideal(WIDTH, HEIGHT)
    matrices[name] = matrices[name].copy()
    matrices[name][row, column] = value
    return matrices


def without(name: str) -> Matrices:
    return {key: matrix for key, matrix in ideal(WIDTH, HEIGHT).items() if key != name}


def replaced(name: str, *shape: int) -> Matrices:
    return {**ideal(WIDTH, HEIGHT), name: numpy.ones(shape)}


@pytest.mark.parametrize("matrices, text", [
    *((without(name), f"{name} is missing") for name in ideal(WIDTH, HEIGHT)),
    (changed("M1", 0, 2, numpy.nan), "M1: value 3 of 9 is not a number"),
    (changed("D2", 0, 4, -numpy.inf), "D2: value 5 of 5 is not a number"),
    (changed("P1", 0, 0, 0), "P1 has no focal length"),
    (changed("M2", 1, 1, 0), "M2 has no focal length"),
    (changed("R2", 0, 0, 0.5), "R2 is no rotation"),
    (changed("P2", 0, 0, 400), "P1 and P2 do not belong together"),
    (changed("P2", 0, 3, 62.5), "the second camera is not to the right of the first"),
    (changed("P2", 0, 3, 0), "the second camera is not to the right of the first"),
    (changed("P2", 1, 3, -500), "one above the other"),
    (replaced("M1", 2, 3), "M1 has 2 rows and 3 columns, not 3 and 3"),
    (replaced("P2", 3, 3), "P2 has 3 rows and 3 columns, not 3 and 4"),
    (replaced("R1", 4, 4), "R1 has 4 rows and 4 columns, which is too many"),
    (replaced("D1", 1, 6), "D1 has 1 rows and 6 columns; one of 4, 5, 8, 12 or 14 values"),
    (replaced("D1", 1, 14), "D1 has a tilt of the sensor"),
])
def test_bad_calibration(tmp_path: pathlib.Path, matrices: Matrices, text: str) -> None:
    refused(write_calibration(tmp_path / "stereo.yml", matrices), text)


def refused(path: pathlib.Path, text: str) -> None:
    result = run(SVS, "-calib", path)
    assert result.returncode == 2 and not result.stdout
    assert result.stderr.startswith(f"{SVS}: {path}: ") and text in result.stderr and result.stderr.count("\n") == 1


@pytest.mark.parametrize("change, text", [
    (lambda text: text.replace("cols: 3", "cols: -3"), "M1 is no matrix as OpenCV writes it"),
    (lambda text: text.replace("!!opencv-matrix", "", 1), "M1 is no matrix as OpenCV writes it"),
    (lambda text: text[:150], "M1: value"),
    (lambda text: text.replace(" ]", ", 1. ]", 1), "M1 has more than 9 values"),
    (lambda text: text.replace("[ 500", "[ nan", 1), "M1: value 1 of 9 is not a number"),
    (lambda text: text.replace("[ 500", "[ inf", 1), "M1: value 1 of 9 is not a number"),
    (lambda text: text.replace("image_width: 64", "image_width: many"), "no size of pictures"),
    (lambda text: "", "M1 is missing"),
    (lambda text: "#" * 70000 + text, "is no calibration"),
    (lambda text: "\0" + text, "is no calibration"),
])
def test_files_that_are_no_calibration(tmp_path: pathlib.Path, change: Callable[[str], str], text: str) -> None:
    path = write_calibration(tmp_path / "stereo.yml", ideal(WIDTH, HEIGHT), (WIDTH, HEIGHT))
    path.write_text(change(path.read_text()))
    refused(path, text)


def test_a_missing_calibration(tmp_path: pathlib.Path) -> None:
    refused(tmp_path / "none.yml", "No such file or directory; ddxvideocalib makes a calibration")


@pytest.mark.strict
@pytest.mark.parametrize("size, fields, text", [
    ((128, 32), 2, "stereo.yml: is for pictures of 128x32, and these are 64x16"),
    (None, 2, "stereo.yml: is not for pictures of 64x16: its centres lie outside"),
    ((64, 32), 1, "video: has 1 fields, not the two of a stereo pair"),
    ((64, 16), 2, "pictures of 64x16 are too small for 80 disparities"),
], ids=["size", "centre", "fields", "disparities"])
def test_pictures_that_do_not_fit(desk: Desk, size: tuple[int, int] | None, fields: int, text: str) -> None:
    """They are counted and reported in a line; afterwards pictures that fit are accepted."""
    wide = {} if size else ideal(2 * WIDTH, 2 * HEIGHT)
    file = write_calibration(desk.folder / "stereo.yml", wide or ideal(WIDTH, HEIGHT), size)
    process = start(desk, file, "-disparities", 80 if "disparities" in text else 64)
    clip = write_clip(desk.folder / "clip.y4m", [numpy.zeros((32, 64), numpy.uint8)] * 3, fields)
    assert desk.run("ddxvideoload", clip, "-layout", "GREY8", "-readers", 1).returncode == 0
    counters = settled(desk, 3)
    check_sum(counters)
    assert counters["out"] == 0 and counters["lost"]["picture"] + counters["lost"]["late"] == 3
    wait_until(lambda: desk.errors(process).count("\n") > 0)
    assert desk.errors(process).count(text) == 1 and desk.errors(process).count("\n") == 1
    assert stop(process)[0] == 0 and desk.item("range") == {}


def test_rectification_equals_opencv_s(desk: Desk) -> None:
    """With strong distortion and rotated cameras, pixels differ from OpenCV's by one level at most."""
    cv2 = module("cv2", "python3-opencv")
    matrices = dict(ideal(160, 120))
    camera = numpy.array([[150, 0, 84], [0, 152, 57], [0, 0, 1.0]])
    matrices.update(M1=camera, M2=camera, D1=numpy.array([[-0.3, 0.1, 0.002, -0.001, 0.01, 0.1, 0.02, 0.001]]),
                    D2=numpy.array([[-0.2, 0.05, -0.002, 0.003, 0.01, 0, 0, 0, 0.01, 0.002, -0.01, 0.003]]),
                    R1=cv2.Rodrigues(numpy.array([0.05, -0.03, 0.02]))[0],
                    R2=cv2.Rodrigues(numpy.array([-0.03, 0.04, -0.03]))[0])
    for name in ("P1", "P2"):
        matrices[name] = numpy.array([[140, 0, 80.0, 0], [0, 140, 60, 0], [0, 0, 1, 0]])
    matrices["P2"][0, 3] = -14
    noise = numpy.random.default_rng(3).integers(0, 256, (2, 60, 80), numpy.uint8).repeat(2, 1).repeat(2, 2)
    ranges, _, _ = ranged(desk, Pair(noise[0], noise[1], numpy.zeros((120, 160), numpy.float32), 16),
                          matrices=matrices)
    fields = numpy.frombuffer(ranges[-1][:3 * 120 * 160], numpy.uint8).reshape(3, 120, 160)
    for eye, field in (("1", 2), ("2", 0)):
        maps = cv2.initUndistortRectifyMap(matrices[f"M{eye}"], matrices[f"D{eye}"], matrices[f"R{eye}"],
                                           matrices[f"P{eye}"], (160, 120), cv2.CV_32FC1)
        expected = cv2.remap(noise[int(eye) - 1], *maps, cv2.INTER_LINEAR)
        x, y = maps
        inside = (x >= 0) & (x <= 159) & (y >= 0) & (y <= 119)
        assert inside.mean() > 0.5 and not fields[field][~((x > -0.1) & (x < 159.1) & (y > -0.1) & (y < 119.1))].any()
        assert numpy.abs(fields[field].astype(int) - expected)[inside].max() <= 2
