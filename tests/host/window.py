# SPDX-License-Identifier: GPL-2.0-or-later
"""A display without a monitor, and what is seen in the window of ddxvideoview: pictures, and the text below them."""
from __future__ import annotations

import dataclasses
import functools
import pathlib
import re
import subprocess
import time
from collections.abc import Callable

import numpy
from numpy.typing import NDArray

from parts.common import TOP
from parts.media.clip import frame_number
from parts.media.display import Display

from .programs import Desk, Process

Image = NDArray[numpy.uint8]
FONT = TOP / "package/ddxvideo/draw/text.c"
CELL, PAD, LINES = (6, 10), 3, 3  # of text.h and picture.c
LIST = (0x10, 0x24, 0x3c)  # behind the list of the keys
PATIENCE = 15  # s; for a machine that hangs


# Sends WM_DELETE_WINDOW: xdotool has no word for that.
CLOSE = """
import ctypes, sys
x11 = ctypes.CDLL("libX11.so.6")
x11.XOpenDisplay.restype = ctypes.c_void_p
display, window = ctypes.c_void_p(x11.XOpenDisplay(None)), int(sys.argv[1])
atoms = [x11.XInternAtom(display, name, 0) for name in (b"WM_PROTOCOLS", b"WM_DELETE_WINDOW")]
event = (ctypes.c_long * 24)(33, 0, 0, 0, window, atoms[0], 32, atoms[1], 0)
x11.XSendEvent(display, ctypes.c_ulong(window), 0, 0, event)
x11.XSync(display, 0)
"""


@functools.cache
def glyphs() -> dict[bytes, str]:
    """The font as the program has it: bands of 16 characters, 9 rows each."""
    rows = [line.strip()[1:-2] for line in FONT.read_text().splitlines() if re.match(r'    "[.#]{5} ', line)]
    found = {}
    for number in range(ord("~") - ord(" ") + 1):
        band, column = divmod(number, 16)
        art = [row.ljust(96)[column * 6:column * 6 + 5] for row in rows[band * 9:band * 9 + 9]]
        found["".join(art).replace(" ", ".").encode()] = chr(ord(" ") + number)
    return found


def read_text(image: Image, scale: int) -> str:
    """The line of text that begins in the corner of an image."""
    text, width = "", CELL[0] * scale
    for left in range(0, image.shape[1] - width + 1, width):
        cell = image[:9 * scale:scale, left:left + width:scale]
        ink = (cell[:, :5] != cell[0, 5]).any(axis=2)
        text += glyphs().get(numpy.where(ink, b"#", b".").tobytes(), "\0")
    return text.rstrip()


@dataclasses.dataclass
class Seen:
    """A screenshot of the window, taken apart."""
    image: Image

    @property
    def scale(self) -> int:
        height, width = self.image.shape[:2]
        return max(1, min(1 if height < 360 else 2 if height < 1000 else height // 500 + 1, width // 312))

    @property
    def area(self) -> Image:
        """Above the text."""
        return self.image[:-LINES * (CELL[1] + PAD) * self.scale]

    def number(self, left: int = 0, top: int = 0, width: int = 0, height: int = 0) -> int | None:
        """The number that is drawn in the picture at this place; by itself, in all of the area."""
        part = self.area[top:top + height or None, left:left + width or None, 1]
        rows = (numpy.arange(288) * 2 + 1) * part.shape[0] // 576
        columns = (numpy.arange(352) * 2 + 1) * part.shape[1] // 704
        return frame_number(part[rows][:, columns].tobytes(), 352, 288)

    def line(self, number: int) -> list[str]:
        """The text of a line, in parts with a ground of their own."""
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

    def frame(self) -> int | None:
        """The number in the text."""
        found = re.search(r"  frame (\d+)", self.text)
        return int(found[1]) if found else None


def parse_xwd(data: bytes) -> Image:
    header = numpy.frombuffer(data, ">u4", 25)
    size, width, height, line, colours = (int(header[i]) for i in (0, 4, 5, 12, 19))
    pixels = numpy.frombuffer(data, numpy.uint8, line * height, size + 12 * colours)
    return pixels.reshape(height, line // 4, 4)[:, :width, 2::-1]


class Window:
    """A running viewer."""

    def __init__(self, desk: Desk, display: Display, *arguments: object, wrapper: tuple[str, ...] = ()) -> None:
        self.display = display
        desk.environment["DISPLAY"] = display.name
        self.process: Process = desk.start("ddxvideoview", *arguments, wrapper=wrapper)
        self.id = display.run("xdotool", "search", "--sync", "--onlyvisible", "--pid", self.process.pid,
                              "--class", "ddxvideoview").split()[-1].decode()
        display.run("xdotool", "windowmove", self.id, 0, 0, "windowfocus", self.id)  # all of it is on the screen

    def see(self) -> Seen:
        return Seen(parse_xwd(self.display.run("xwd", "-silent", "-id", self.id)))

    def until(self, condition: Callable[[Seen], object]) -> Seen:
        """What is seen as soon as the condition holds; what is seen last, if it never does."""
        end = time.monotonic() + PATIENCE
        while not condition(seen := self.see()) and time.monotonic() < end:
            pass
        return seen

    def point(self, x: int, y: int) -> None:
        self.display.run("xdotool", "mousemove", "--window", self.id, x, y)

    def press(self, *keys: str) -> Seen:
        """Press keys, and see what came of it: `?` shows and hides the list, after all keys before it."""
        self.display.run("xdotool", "key", "--delay", "0", *keys, "question")
        self.until(lambda seen: seen.is_listing())
        self.display.run("xdotool", "key", "question")
        return self.until(lambda seen: not seen.is_listing())

    def close(self) -> None:
        """As a window manager does it."""
        self.display.run("/usr/bin/python3", "-B", "-c", CLOSE, self.id)
