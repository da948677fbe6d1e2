# SPDX-License-Identifier: GPL-2.0-or-later
"""Photographed stereo pairs with their true disparities."""
import dataclasses
import pathlib
import subprocess
from typing import Any

import numpy
from numpy.typing import NDArray

from parts.image import wheels
from parts.media.examples import example

Grey = NDArray[numpy.uint8]
Map = NDArray[numpy.float32]  # disparities in pixels; 0 or infinite: unknown


@dataclasses.dataclass
class Pair:
    left: Grey
    right: Grey
    truth: Map
    disparities: int

    def wrong(self, found: Map) -> float:
        """The share of pixels that are missing or more than two pixels off; without those of unknown disparity and
        without the margin in which OpenCV's matchers find nothing."""
        known = numpy.isfinite(self.truth) & (self.truth > 0) & (self.truth < self.disparities - 1)
        known[:, :self.disparities] = False
        return float(1 - ((found > 0) & (numpy.abs(found - self.truth) <= 2))[known].mean())


def grey(path: pathlib.Path) -> Grey:
    """A picture, converted to grey."""
    command = ["ffmpeg", "-v", "error", "-nostdin", "-i", str(path), "-vf", "scale=out_range=pc,format=gray",
               "-f", "image2pipe", "-c:v", "pgm", "-"]
    magic, size, _, pixels = subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout.split(b"\n", 3)
    assert magic == b"P5"
    width, height = map(int, size.split())
    return numpy.frombuffer(pixels, numpy.uint8).reshape(height, width)


def _shares(old: int, new: int) -> NDArray[numpy.float64]:
    """The share of each of `old` pixels of a row in each of `new` pixels of the same width."""
    edges = numpy.arange(new + 1) * old / new
    pixels = numpy.arange(old)
    covered = numpy.clip(numpy.minimum(edges[1:, None], pixels + 1) - numpy.maximum(edges[:-1, None], pixels), 0, 1)
    return numpy.asarray(covered * new / old)


def _shrunk(pair: Pair, factor: int, disparities: int) -> Pair:
    """Like cv2.resize() with INTER_AREA, the truth with INTER_NEAREST; width and height are multiples of four."""
    height, width = pair.truth.shape
    rows, columns = (side // factor // 4 * 4 for side in (height, width))

    def mean(picture: Grey) -> Grey:
        shrunk = _shares(height, rows) @ picture @ _shares(width, columns).T
        return numpy.asarray(numpy.round(shrunk), numpy.uint8)

    truth = pair.truth[numpy.arange(rows) * height // rows][:, numpy.arange(columns) * width // columns] / factor
    return Pair(mean(pair.left), mean(pair.right), truth.astype(numpy.float32), disparities)


def motorcycle(factor: int, disparities: int) -> Pair:
    """A pair of Middlebury's 2014 data, from scikit-image's examples."""
    folder = wheels.folder(wheels.SKIMAGE, wheels.PYTHON_37, "skimage/data/motorcycle") / "skimage/data"
    file: Any = numpy.load(folder / "motorcycle_disp.npz")
    whole = Pair(grey(folder / "motorcycle_left.png"), grey(folder / "motorcycle_right.png"),
                 file["arr_0"].astype(numpy.float32), disparities)
    return whole if factor == 1 else _shrunk(whole, factor, disparities)


def aloe(factor: int, disparities: int) -> Pair:
    """A pair of Middlebury's 2006 data, from OpenCV's examples."""
    whole = Pair(grey(example("aloeL.jpg")), grey(example("aloeR.jpg")),
                 grey(example("aloeGT.png")).astype(numpy.float32), disparities)
    return whole if factor == 1 else _shrunk(whole, factor, disparities)


def chessboard(number: int) -> tuple[Grey, Grey]:
    """Left and right view of a board with 9x6 corners, from OpenCV's examples: number 1 to 9 and 11 to 14."""
    return grey(example(f"left{number:02d}.jpg")), grey(example(f"right{number:02d}.jpg"))


CHESSBOARDS = [*range(1, 10), 11, 12, 13, 14]
