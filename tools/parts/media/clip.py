#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""The test clip: moving content, with the number of each frame drawn into the picture.

usage: clip.py FILE [SECONDS]      CIF, 25 frames a second, 4:2:0

The number's 32 bits are black and white blocks of 16x16 pixels, four rows of eight, highest bit first, followed by four
inverted rows. Comparing each block with its inverse makes the number independent of brightness, contrast and lossy
coding, and shows whether a picture has a number.
"""
import pathlib
import sys

import numpy
from numpy.typing import NDArray

WIDTH, HEIGHT, RATE, SECONDS = 352, 288, 25, 20
SHORT = 10  # s of the clip that each run of the boot tests records
BLOCK, ACROSS, DOWN = 16, 8, 4
BLACK, WHITE = 24, 224
LEAST_CONTRAST = 40

Plane = NDArray[numpy.uint8]


def draw_number(luma: Plane, number: int) -> None:
    bits = numpy.array([number >> (31 - i) & 1 for i in range(32)]).reshape(DOWN, ACROSS)
    pattern = numpy.kron(numpy.vstack([bits, 1 - bits]), numpy.ones((BLOCK, BLOCK), int))
    luma[:pattern.shape[0], :pattern.shape[1]] = numpy.where(pattern, WHITE, BLACK)


def frame_number(luma: bytes, width: int, height: int) -> int | None:
    """The number in a picture's Y plane; None if there is none."""
    if width < ACROSS * BLOCK or height < 2 * DOWN * BLOCK:
        return None
    plane = numpy.frombuffer(luma, numpy.uint8, width * height).reshape(height, width)
    area = plane[:2 * DOWN * BLOCK, :ACROSS * BLOCK].reshape(2 * DOWN, BLOCK, ACROSS, BLOCK)
    means = area[:, 4:12, :, 4:12].mean(axis=(1, 3))  # the middle of each block: edges blur
    contrast = means[:DOWN] - means[DOWN:]
    if numpy.abs(contrast).min() < LEAST_CONTRAST:
        return None
    number = 0
    for bit in (contrast > 0).flatten():
        number = number << 1 | int(bit)
    return number


def picture(number: int) -> bytes:
    """Frame `number`: waves that move a few pixels a frame, a bouncing ball, the number; as Y, U and V planes."""
    y, x = numpy.mgrid[0:HEIGHT, 0:WIDTH]
    luma = (128 + 50 * numpy.sin((x + 3 * number) / 17) + 40 * numpy.sin((y - 2 * number) / 11)).astype(numpy.uint8)
    ball_x, ball_y = (abs((speed * number) % (2 * size) - size) for speed, size in [(5, WIDTH), (4, HEIGHT)])
    luma[(x - ball_x) ** 2 + (y - ball_y) ** 2 < 30 ** 2] = 235
    draw_number(luma, number)
    small_y, small_x = y[::2, ::2], x[::2, ::2]
    blue = (128 + 60 * numpy.sin((small_x + 2 * number) / 40)).astype(numpy.uint8)
    red = (128 + 60 * numpy.cos((small_y + number) / 30)).astype(numpy.uint8)
    return bytes(luma.tobytes() + blue.tobytes() + red.tobytes())


def write(path: pathlib.Path, seconds: int = SECONDS) -> pathlib.Path:
    with path.open("wb") as file:
        file.write(f"YUV4MPEG2 W{WIDTH} H{HEIGHT} F{RATE}:1 Ip A1:1 C420jpeg\n".encode())
        for number in range(seconds * RATE):
            file.write(b"FRAME\n" + picture(number))
    return path


if __name__ == "__main__":
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__)
    write(pathlib.Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) == 3 else SECONDS)
