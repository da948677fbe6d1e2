# SPDX-License-Identifier: GPL-2.0-or-later
"""CIF clips at 25 frames a second with a number in each picture, for benchmarks of the stream."""
import pathlib
from collections.abc import Callable

import numpy
from numpy.typing import NDArray

from parts.common import OUTPUT
from parts.media import clip
from parts.media.footage import footage

WIDTH, HEIGHT, RATE = clip.WIDTH, clip.HEIGHT, clip.RATE
LUMA = WIDTH * HEIGHT
PICTURE = LUMA * 3 // 2
SIZE = f"{WIDTH}x{HEIGHT}"
# A window that moves across the real clip, so that each pixel changes.
PAN = f"{WIDTH}:{HEIGHT}:(iw-{WIDTH})/2*(1+sin(t*0.8)):(ih-{HEIGHT})/2*(1+cos(t*0.5))"

Pictures = NDArray[numpy.uint8]  # each row is a picture: Y, U and V planes

MADE: dict[str, Callable[[pathlib.Path, int], pathlib.Path]] = {
    "real": lambda path, frames: footage(path, frames, SIZE),
    "moving": lambda path, frames: footage(path, frames, SIZE, PAN),
    "drawn": lambda path, frames: clip.write(path, frames // RATE)}


def numbered(name: str, seconds: int) -> pathlib.Path:
    """A clip: `real` from a still camera, `moving` from a moving one, `drawn` by a computer."""
    path = OUTPUT / f"bench/{name}-{seconds}.y4m"
    if path.exists():
        return path
    path.parent.mkdir(parents=True, exist_ok=True)
    plain = MADE[name](path.with_suffix(".plain.y4m"), seconds * RATE)
    with plain.open("rb") as source, path.with_suffix(".new").open("wb") as target:
        target.write(source.readline())
        for number in range(seconds * RATE):
            target.write(source.readline())
            plane = numpy.frombuffer(source.read(LUMA), numpy.uint8).reshape(HEIGHT, WIDTH).copy()
            clip.draw_number(plane, number)
            target.write(plane.tobytes() + source.read(PICTURE - LUMA))
    plain.unlink()
    path.with_suffix(".new").rename(path)
    return path


def pictures(path: pathlib.Path) -> Pictures:
    """The pictures of a clip that numbered() made."""
    with path.open("rb") as file:
        begin = len(file.readline())
    line = len(b"FRAME\n")
    frames = numpy.fromfile(path, numpy.uint8, offset=begin).reshape(-1, line + PICTURE)
    return frames[:, line:]
