# SPDX-License-Identifier: GPL-2.0-or-later
"""Calibrations of stereo pairs, as OpenCV writes them."""
from collections.abc import Mapping

import numpy
from numpy.typing import NDArray

Matrices = Mapping[str, NDArray[numpy.float64]]
FOCUS, BASELINE = 500.0, 0.125


def ideal(width: int, height: int) -> dict[str, NDArray[numpy.float64]]:
    """The calibration of cameras without distortion, side by side: rectification changes nothing."""
    camera = numpy.array([[FOCUS, 0, width / 2], [0, FOCUS, height / 2], [0, 0, 1]])
    left = numpy.hstack([camera, numpy.zeros((3, 1))])
    right = left.copy()
    right[0, 3] = -FOCUS * BASELINE
    return {"M1": camera, "D1": numpy.zeros((1, 5)), "M2": camera, "D2": numpy.zeros((1, 5)), "R1": numpy.eye(3),
            "R2": numpy.eye(3), "P1": left, "P2": right}


def text(matrices: Matrices, size: tuple[int, int] | None = None) -> str:
    """The text of the file: four numbers a line, and the size of the pictures if it is given."""
    lines = ["%YAML:1.0", "---"]
    if size:
        lines += [f"image_width: {size[0]}", f"image_height: {size[1]}"]
    for name, matrix in matrices.items():
        numbers = ", ".join(_number(float(value)) + ("\n      " if place % 4 == 3 else "")
                            for place, value in enumerate(matrix.flat))
        lines += [f"{name}: !!opencv-matrix", f"   rows: {matrix.shape[0]}", f"   cols: {matrix.shape[1]}", "   dt: d",
                  f"   data: [ {numbers} ]"]
    return "\n".join(lines) + "\n"


def _number(value: float) -> str:
    return ".Nan" if numpy.isnan(value) else "-.Inf" if value == -numpy.inf else f"{value:.17g}"
