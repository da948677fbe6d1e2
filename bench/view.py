# SPDX-License-Identifier: GPL-2.0-or-later
"""make bench: the viewer compared with mpv, ffplay and sws_scale(). See docs/screens.md.

tools/bench view [-steps N] [-starts N] [-short]: presses keys under an X server without a monitor and watches one
pixel. Measures the time from a key to the picture, for steps forward and back in a 1080p Y4M file, beside mpv; from
the start to the first picture of a CIF clip, beside ffplay; and CPU time for a frame, beside sws_scale() alone. Writes
output/bench/view.json. -short: a few steps, without mpv and ffplay, for the gate; writes no file.
"""
import argparse
import contextlib
import ctypes
import json
import os
import pathlib
import statistics
import subprocess
import time
from collections.abc import Iterator
from typing import Any

from bench.measure import percentile, save
from parts.common import MEMORY, MORTAL, OUTPUT, Failed, command_line, finish, run, say, scratch
from parts.image import native
from parts.media.display import Display
from parts.processes import stop
PATIENCE = 20  # s, for a program that hangs
LEVELS, SPACING, BASE = 20, 10, 30
AT = (500, 400)  # a point on the screen that all windows cover
ROOT = OUTPUT / "desk/root"
KEYS = {"forward": b"period", "back": b"comma"}


class Screen(Display):
    """A display whose keys can be pressed and of which one pixel is read."""

    def __init__(self) -> None:
        super().__init__()
        self.x11, self.test = ctypes.CDLL("libX11.so.6"), ctypes.CDLL("libXtst.so.6")
        for name in ("XOpenDisplay", "XGetImage"):
            getattr(self.x11, name).restype = ctypes.c_void_p
        for name in ("XGetPixel", "XStringToKeysym", "XDefaultRootWindow"):
            getattr(self.x11, name).restype = ctypes.c_ulong
        self.display = ctypes.c_void_p(self.x11.XOpenDisplay(self.name.encode()))
        self.root = ctypes.c_ulong(self.x11.XDefaultRootWindow(self.display))
        self.x11.XWarpPointer(self.display, 0, self.root, 0, 0, 0, 0, *AT)

    def give_focus(self) -> None:
        """Send keys to the window under the pointer: when a focused window closes, no window has the focus."""
        pointer_root = ctypes.c_ulong(1)
        self.x11.XSetInputFocus(self.display, pointer_root, 1, ctypes.c_ulong(0))
        self.x11.XSync(self.display, 0)

    def level(self) -> int:
        """The pixel's green value."""
        image = ctypes.c_void_p(self.x11.XGetImage(self.display, self.root, AT[0] + 20, AT[1] + 20, 1, 1,
                                                   ctypes.c_ulong(0xffffffff), 2))
        green = int(self.x11.XGetPixel(image, 0, 0)) >> 8 & 255
        self.x11.XDestroyImage(image)
        return green

    def press(self, key: bytes) -> None:
        code = self.x11.XKeysymToKeycode(self.display, ctypes.c_ulong(self.x11.XStringToKeysym(key)))
        for down in (1, 0):
            self.test.XTestFakeKeyEvent(self.display, code, down, 0)
        self.x11.XFlush(self.display)

    def wait(self, name: str, number: int, begin: float) -> float:
        """ms from `begin` until `name` shows the frame with this number."""
        while abs(self.level() - shade(number)) > SPACING // 2 - 1:
            if time.monotonic() - begin > PATIENCE:
                raise Failed(f"{name}: frame {number} was not shown: the pixel is {self.level()}, not {shade(number)}")
        return (time.monotonic() - begin) * 1000

    def end(self) -> None:
        self.x11.XCloseDisplay(self.display)
        super().end()


def shade(number: int) -> int:
    """The grey value of frame `number`, full range."""
    return BASE + number % LEVELS * SPACING


def make_clip(path: pathlib.Path, width: int, height: int, frames: int) -> pathlib.Path:
    """A clip whose frames are each one grey, in studio range, as players expect."""
    with path.open("wb") as file:
        file.write(b"YUV4MPEG2 W%d H%d F25:1 Ip A1:1 C420mpeg2\n" % (width, height))
        for number in range(frames):
            luma = round(16 + shade(number) * 219 / 255)
            file.write(b"FRAME\n" + bytes([luma]) * (width * height) + bytes([128]) * (width * height // 2))
    return path


def commands(clip: pathlib.Path) -> dict[str, list[str]]:
    viewer = str(ROOT / "usr/bin/ddxvideoview")
    return {"ddxvideoview": [viewer, str(clip)],
            "mpv": ["mpv", "--no-config", "--vo=x11", "--pause", "--no-osc", "--osd-level=0", "--ao=null",
                    "--no-border", "--really-quiet", "--geometry=1280x720", "--keep-open=yes", str(clip)],
            "ffplay": ["ffplay", "-loglevel", "quiet", "-nostats", "-an", str(clip)]}


def start(screen: Screen, command: list[str]) -> subprocess.Popen[bytes]:
    screen.give_focus()
    return subprocess.Popen([*MORTAL, *command], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
                            stderr=subprocess.DEVNULL, env={**os.environ, **native.environment(ROOT),
                                                            "DISPLAY": screen.name, "SDL_VIDEODRIVER": "x11"})


@contextlib.contextmanager
def paused(screen: Screen, name: str, clip: pathlib.Path) -> Iterator[None]:
    """A player that shows the first frame."""
    process = start(screen, commands(clip)[name])
    try:
        if name == "ddxvideoview":
            while screen.level() < BASE - SPACING // 2:  # no picture yet
                time.sleep(0.01)
            screen.press(b"comma")  # pauses, also after the last frame
            screen.press(b"Home")
        screen.wait(name, 0, time.monotonic())
        time.sleep(0.5)
        yield
    finally:
        stop(process)


def pressed(screen: Screen, name: str, key: bytes, number: int) -> float:
    """ms from a key to the frame with this number."""
    begin = time.monotonic()
    screen.press(key)
    passed = screen.wait(name, number, begin)
    time.sleep(0.02)
    return passed


def steps(screen: Screen, name: str, clip: pathlib.Path, count: int, frames: int) -> dict[str, list[float]]:
    """Time of each step, forward from the first frame and back from the last."""
    found: dict[str, list[float]] = {"forward": [], "back": []}
    with paused(screen, name, clip):
        at = 0
        while min(map(len, found.values())) < count:
            for way, key in KEYS.items():
                for _ in range(frames - 1):
                    at += 1 if way == "forward" else -1
                    found[way].append(pressed(screen, name, key, at))
    return found


def first_picture(screen: Screen, name: str, clip: pathlib.Path) -> float:
    command = commands(clip)[name]
    begin = time.monotonic()
    process = start(screen, command)
    try:
        while screen.level() < BASE - SPACING // 2:  # the screen is black
            if time.monotonic() - begin > PATIENCE:
                raise Failed(f"{name} showed nothing")
        return (time.monotonic() - begin) * 1000
    finally:
        stop(process)
        while screen.level():
            time.sleep(0.01)


def summary(values: list[float]) -> dict[str, float]:
    return {"p50_ms": round(statistics.median(values), 1), "p99_ms": round(percentile(values, 99), 1),
            "count": len(values)}


def measure(screen: Screen, folder: pathlib.Path, options: argparse.Namespace) -> dict[str, Any]:
    frames = LEVELS if not options.short else 5
    large = make_clip(folder / "large.y4m", 1920, 1080, frames)
    small = make_clip(folder / "small.y4m", 352, 288, 50)
    players = ["ddxvideoview"] if options.short else ["ddxvideoview", "mpv"]
    found: dict[str, Any] = {"steps": {}, "start": {}}
    for name in players:
        for way, values in steps(screen, name, large, options.steps, frames).items():
            found["steps"][f"{name} {way}"] = summary(values)
    starts: dict[str, list[float]] = {}
    for _ in range(options.starts):
        for name in ["ddxvideoview"] if options.short else ["ddxvideoview", "ffplay"]:
            starts.setdefault(name, []).append(first_picture(screen, name, small))
    found["start"] = {name: summary(values) for name, values in starts.items()}
    found["frame"] = json.loads(run([OUTPUT / "desk/ddxvideo/tests/view", str(options.frames)]))
    return found


def main() -> int:
    options = command_line(__doc__, steps=200, starts=20, short=False)
    options.frames = 500
    if options.short:
        options.steps, options.starts, options.frames = 4, 1, 20
    native.build()
    with scratch(MEMORY) as folder, Screen() as screen:
        found = measure(screen, folder, options)
    for name, row in {**found["steps"], **{f"{name} start": row for name, row in found["start"].items()}}.items():
        say(f"{name:24} p50 {row['p50_ms']:6.1f} ms  p99 {row['p99_ms']:6.1f} ms")
    frame = found["frame"]
    say(f"frame: {frame['viewer_us']:.0f} us, sws_scale() alone {frame['sws_scale_us']:.0f} us: {frame['ratio']:.2f}")
    if not options.short:
        save("view", found)
    return 0


if __name__ == "__main__":
    finish("bench", main)
