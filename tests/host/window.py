# SPDX-License-Identifier: GPL-2.0-or-later
"""A viewer's window on a display."""
from __future__ import annotations

import time
from collections.abc import Callable

import numpy

from lib.seen import Image, Seen
from parts.media.display import Display

from .programs import Desk, Process

PATIENCE = 15  # s; limits a test that hangs

# Sends WM_DELETE_WINDOW, which xdotool cannot do.
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
        self.id = display.run("xdotool", "search", "--all", "--sync", "--onlyvisible", "--pid", self.process.pid,
                              "--class", "ddxvideoview").split()[-1].decode()
        display.run("xdotool", "windowmove", self.id, 0, 0, "windowfocus", self.id)  # completely on the screen

    def see(self) -> Seen:
        return Seen(parse_xwd(self.display.run("xwd", "-silent", "-id", self.id)))

    def until(self, condition: Callable[[Seen], object]) -> Seen:
        """Wait until the condition holds, or time out; return the last picture seen."""
        end = time.monotonic() + PATIENCE
        while not condition(seen := self.see()) and time.monotonic() < end:
            pass
        return seen

    def point(self, x: int, y: int) -> None:
        self.display.run("xdotool", "mousemove", "--window", self.id, x, y)

    def press(self, *keys: str) -> Seen:
        """Press keys and return the result: a final `?` shows and hides the list, after all other keys are handled."""
        self.display.run("xdotool", "key", "--delay", "0", *keys, "question")
        self.until(lambda seen: seen.is_listing())
        self.display.run("xdotool", "key", "question")
        return self.until(lambda seen: not seen.is_listing())

    def close(self) -> None:
        """Close like a window manager does."""
        self.display.run("/usr/bin/python3", "-B", "-c", CLOSE, self.id)
