# SPDX-License-Identifier: GPL-2.0-or-later
"""A screenshot of ddxvideoview: the number in its picture, and the text below it."""
import dataclasses
import functools
import re

import numpy
from numpy.typing import NDArray

from parts.common import TOP
from parts.media.clip import frame_number

Image = NDArray[numpy.uint8]  # rows, columns, red green blue
FONT = TOP / "package/ddxvideo/draw/text.c"
CELL, PAD, LINES = (6, 10), 3, 3  # of text.h and picture.c
LIST, ITEMS = (0x10, 0x24, 0x3c), (0x2c, 0x10, 0x40)  # backgrounds: list of the keys, of the items


def ppm(data: bytes) -> Image:
    head = re.match(rb"P6\n(\d+) (\d+)\n255\n", data)
    assert head
    return numpy.frombuffer(data, numpy.uint8, offset=head.end()).reshape(int(head[2]), int(head[1]), 3)


@functools.cache
def glyphs() -> dict[bytes, str]:
    """The font from the program's source: bands of 16 characters, 9 rows each."""
    rows = [line.strip()[1:-2] for line in FONT.read_text().splitlines() if re.match(r'    "[.#]{5} ', line)]
    found = {}
    for number in range(ord("~") - ord(" ") + 1):
        band, column = divmod(number, 16)
        art = [row.ljust(96)[column * 6:column * 6 + 5] for row in rows[band * 9:band * 9 + 9]]
        found["".join(art).replace(" ", ".").encode()] = chr(ord(" ") + number)
    return found


def read_text(image: Image, scale: int) -> str:
    """The line of text in the corner of an image; long lines have smaller letters."""
    found = [read_letters(image, size) for size in range(scale, 0, -1)]
    return next((text for text in found if "\0" not in text), found[0])


def read_letters(image: Image, scale: int) -> str:
    text, width = "", CELL[0] * scale
    for left in range(0, image.shape[1] - width + 1, width):
        cell = image[:9 * scale:scale, left:left + width:scale]
        ink = (cell[:, :5] != cell[0, 5]).any(axis=2)
        text += glyphs().get(numpy.where(ink, b"#", b".").tobytes(), "\0")
    return text.rstrip()


@dataclasses.dataclass
class Seen:
    """The parts of a screenshot of ddxvideoview."""
    image: Image

    @property
    def scale(self) -> int:
        height, width = self.image.shape[:2]
        return max(1, min(1 if height < 360 else 2 if height < 1000 else height // 500 + 1, width // 312))

    @property
    def area(self) -> Image:
        """The area above the text."""
        return self.image[:-LINES * (CELL[1] + PAD) * self.scale]

    def number(self, left: int = 0, top: int = 0, width: int = 0, height: int = 0) -> int | None:
        """The number in the picture at this place; by default in the whole area."""
        part = self.area[top:top + height or None, left:left + width or None, 1]
        rows = (numpy.arange(288) * 2 + 1) * part.shape[0] // 576
        columns = (numpy.arange(352) * 2 + 1) * part.shape[1] // 704
        return frame_number(part[rows][:, columns].tobytes(), 352, 288)

    def line(self, number: int) -> list[str]:
        """The text of a line, in parts with different backgrounds."""
        top = len(self.area) + number * (CELL[1] + PAD) * self.scale
        ground = self.image[top].astype(int) @ (65536, 256, 1)
        edges = [0, *(numpy.flatnonzero(numpy.diff(ground)) + 1), len(ground)]
        top += PAD * self.scale // 2 + self.scale // 2
        return [read_text(self.image[top:, begin + PAD * self.scale:end], self.scale)
                for begin, end in zip(edges, edges[1:])]

    @property
    def label(self) -> str:
        return self.line(0)[0]

    @property
    def text(self) -> str:
        return "\n".join(" ".join(self.line(number)) for number in range(LINES))

    def is_listing(self) -> bool:
        """Whether the list of the keys is shown."""
        return bool((self.area == LIST).all(axis=2).mean() > 0.1)

    def items(self) -> list[str]:
        """The lines of the list of the items."""
        rows, columns = numpy.nonzero((self.area == ITEMS).all(axis=2))
        if not rows.size:
            return []
        wide, high = CELL[0] * self.scale, CELL[1] * self.scale
        tops = range(int(rows.min()) + high // 2, int(rows.max()) + 1 - high // 2, high)
        left, right = int(columns.min()) + 2 * wide, int(columns.max()) + 1
        return [read_text(self.area[top:, left:right], self.scale) for top in tops]

    def frame(self) -> int | None:
        """The number in the text."""
        found = re.search(r"  frame (\d+)", self.text)
        return int(found[1]) if found else None

    def frame_before(self) -> int:
        """The number of the frame before the step to this one; the text states lost frames between them."""
        found = re.search(r"(\d+) missing before this one", self.text)
        return (self.frame() or 0) - 1 - (int(found[1]) if found else 0)

    def newer(self) -> int:
        """The number of newer frames, while the viewer is paused."""
        found = re.search(r"  (\d+) newer", self.text)
        return int(found[1]) if found else 0
