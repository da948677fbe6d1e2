# SPDX-License-Identifier: GPL-2.0-or-later
"""Figures of one run over a lossy link, from the pictures that were shown.

Usable: shown within the peer's deadline after the robot's write, at most WORSE dB below the same frame of the run
without loss. The screen for a frame is the newest picture at the frame's deadline that is not of a later frame: the
operator's picture with that delay. Its difference from the source picture includes the error of an old picture.
Latencies are those of frames with that quality, at any time. PSNR is over all three planes.

At a low rate, the number in a picture may be unreadable or that of the picture before, though the picture is within
WORSE dB. Then the number follows from the pictures around it: see with_inferred()."""
import dataclasses
import math
from collections.abc import Sequence

import numpy
from numpy.typing import NDArray

from bench.clips import PICTURE, Pictures
from bench.loss_peers import Shown
from bench.measure import percentile

WORSE = 3.0  # dB
MS = 1e6  # ns
NOTHING = numpy.full(PICTURE, 128, numpy.uint8)  # before the first picture
PERFECT = 99.0  # dB

Picture = NDArray[numpy.uint8]


def psnr(one: Picture, other: Picture) -> float:
    error = float(numpy.square(numpy.subtract(one, other, dtype=numpy.int16), dtype=numpy.int32).mean())
    return 10 * math.log10(255 ** 2 / error) if error else PERFECT


def mean(values: list[float]) -> float:
    return sum(values) / len(values) if values else float("nan")


def with_inferred(numbers: Sequence[int | None]) -> list[int | None]:
    """Numbers of pictures in the order of display. Pictures without a new number, between two others, are the frames
    between those if there are exactly as many."""
    found = list(numbers)
    before, last = 0, -1  # the last new number, and its index
    for index, number in enumerate(numbers):
        if number is None or number <= last:
            continue
        if last >= 0 and number - last == index - before:
            found[before:index] = range(last, number)
        before, last = index, number
    return found


def longest_pause(times: list[int]) -> float:
    """The longest time between two of these times, in ms."""
    ordered = sorted(times)
    return max((after - before for before, after in zip(ordered, ordered[1:])), default=math.nan) / MS


@dataclasses.dataclass
class View:
    """The clip on one operator's screen."""
    source: Pictures
    written: dict[int, int]
    shown: Shown
    deadline_ms: int

    def __post_init__(self) -> None:
        count = min(len(self.shown.pictures), len(self.shown.times))
        self.copies: dict[int, list[int]] = {}  # indices of each frame's pictures, in the order of display
        last = -1
        self.order: list[int] = []  # number of each picture; if unreadable, one more than the picture before
        for index, number in enumerate(with_inferred(self.shown.numbers[:count])):
            last = last + 1 if number is None else number
            self.order.append(last)
            if number in self.written and self.delay(last, index) >= 0:
                self.copies.setdefault(last, []).append(index)
        self.quality = {number: [psnr(self.shown.pictures[index], self.source[number]) for index in indices]
                        for number, indices in self.copies.items()}

    def delay(self, number: int, index: int) -> float:
        """ms"""
        return (self.shown.times[index] - self.written[number]) / MS

    def first_good(self, number: int, wanted: float) -> float | None:
        """ms until the frame was shown with this quality."""
        return next((self.delay(number, index) for index, quality in zip(self.copies.get(number, []),
                                                                         self.quality.get(number, []))
                     if quality >= wanted), None)

    def screen(self, number: int) -> Picture:
        """The picture at the frame's deadline."""
        deadline = self.written[number] + self.deadline_ms * MS
        there = [index for index, known in enumerate(self.order)
                 if known <= number and self.shown.times[index] <= deadline]
        picture: Picture = self.shown.pictures[there[-1]] if there else NOTHING
        return picture

    def best(self) -> dict[int, float]:
        """Quality of each frame that was shown."""
        return {number: max(qualities) for number, qualities in self.quality.items()}


def figures(view: View, clean: dict[int, float], frames: list[int]) -> dict[str, float]:
    """`clean`: best() of the run without loss. A frame that the run lacks must be as good as its mean. `longest_ms`:
    between two new pictures on the screen, of any quality; the time between two frames is a part of it."""
    usual = mean(list(clean.values()))
    good = {number: view.first_good(number, clean.get(number, usual) - WORSE) for number in frames}
    usable = [number for number, delay in good.items() if delay is not None and delay <= view.deadline_ms]
    shown = [number for number in frames if number in view.copies]
    delays = [delay for delay in good.values() if delay is not None]
    screen = [psnr(view.screen(number), view.source[number]) for number in frames]
    return {"usable": 100 * len(usable) / len(frames),
            "whole": 100 * sum(delay is not None for delay in good.values()) / len(frames),
            "shown": 100 * len(shown) / len(frames), "screen_db": mean(screen),
            "frame_db": mean([view.best()[number] for number in shown]), "p50_ms": percentile(delays, 50),
            "p99_ms": percentile(delays, 99),
            "longest_ms": longest_pause([view.shown.times[view.copies[number][0]] for number in shown])}


def usable_at(view: View, clean: dict[int, float], time: int) -> float | None:
    """s from this time until a frame that was written later was usable; None if there is none."""
    usual = mean(list(clean.values()))
    ready = [view.shown.times[view.copies[number][0]] for number in sorted(view.copies)
             if view.written.get(number, 0) >= time
             and (delay := view.first_good(number, clean.get(number, usual) - WORSE)) is not None
             and delay <= view.deadline_ms]
    return (min(ready) - time) / 1e9 if ready else None
