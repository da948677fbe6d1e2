# SPDX-License-Identifier: GPL-2.0-or-later
"""Compare each picture of a stream with the recording of its time, for clips without numbers in their pictures.

A lossy picture is compared with the recorded picture of its time (the due one) and with the neighbours of that, because
neighbours in a real clip can be nearly equal. Only pixels that differ between the due picture and a neighbour count:
there, the lossy picture is at 0 if it equals the due one, at 1 if it equals the neighbour; codec errors favour neither.
"""
import bisect
import dataclasses
import math
import pathlib
import statistics

import numpy
from numpy.typing import NDArray

from parts.media import y4m
from parts.media.clip import frame_number

STEPS = (1, 2, 5, 12, 25)  # distances of the neighbours, before and after
CHANGE = 24        # grey levels; the codec may lose a smaller change
LEAST = 1 / 2000   # share of pixels that must change to distinguish two pictures
OTHER = 0.75       # from here on, the picture counts as the neighbour
DUE = 0.25         # up to here, it counts as the due one
ROUNDED = 65.0     # squared error that is always accepted, 30 dB
NOTHING = 0.9      # squared error in variances of the due picture; a grey picture has 1
PERFECT = 99.0     # dB, for a picture without errors
LEGIBLE = 15.0     # dB of the median picture; below, the codec has left too little of a noisy clip to judge it
SAME = 1_000_000   # ns; closer time stamps are of the same frame, since RTP and NTP round

Luma = NDArray[numpy.uint8]


class Recording:
    """The pictures of a file, read one at a time, since a large recording does not fit into memory."""

    def __init__(self, path: pathlib.Path) -> None:
        self.header, frames = y4m.read(path)
        self.path, self.start = path, None
        self.times: list[int] = []           # ns since the first frame
        self.numbers: list[int | None] = []  # in the pictures
        self.positions: list[int] = []
        for frame in frames:
            self.start = self.start if self.times else frame.start
            self.times.append(frame.time or 0)
            self.numbers.append(frame_number(frame.data, self.header.width, self.header.height))
            self.positions.append(frame.position)

    @property
    def numbered(self) -> bool:
        return None not in self.numbers

    def luma(self, index: int) -> Luma:
        size = self.header.width * self.header.height
        return numpy.fromfile(self.path, numpy.uint8, size, offset=self.positions[index])

    def at(self, time: int) -> int | None:
        """The index of the frame with that time."""
        near = bisect.bisect_left(self.times, time - SAME)
        return near if near < len(self.times) and self.times[near] <= time + SAME else None


@dataclasses.dataclass
class Likeness:
    wrong: list[int]        # indices of pictures that are not the due ones
    psnr: list[float]       # dB, of each picture with a due one
    told: int = 0           # pictures in which a shift by one frame would be noticed

    @property
    def legible(self) -> bool:
        return not self.psnr or statistics.median(self.psnr) >= LEGIBLE

    def figures(self) -> dict[str, object]:
        return {"compared_by": "picture", "pictures": len(self.psnr), "unlike_their_neighbours": self.told,
                "psnr_db": {"least": round(min(self.psnr, default=0.0), 1),
                            "mean": round(sum(self.psnr) / max(1, len(self.psnr)), 1)}}

    def words(self) -> str:
        text = (f"The clip has no frame numbers in its pictures. {len(self.psnr)} pictures of the stream were compared "
                f"with the recorded ones of the same time")
        if self.psnr:
            text += f": PSNR {min(self.psnr):.1f} dB at least, {sum(self.psnr) / len(self.psnr):.1f} dB on average"
        if not self.legible:
            return f"{text}. At this bit rate the codec leaves too little of the pictures to tell them apart."
        if not self.told:
            return f"{text}. The clip stands still, or nearly so: a shift by one frame can hardly be seen in it."
        return f"{text}. {self.told} of them differ enough from their neighbours to show a shift by one frame."


def place(shown: Luma, due: Luma, other: Luma) -> float | None:
    """0: the due picture, 1: the other one; None if these are too similar."""
    change = numpy.subtract(other, due, dtype=numpy.int16)
    mask = numpy.abs(change) > CHANGE
    if numpy.count_nonzero(mask) < max(1.0, LEAST * mask.size):
        return None
    part = change[mask].astype(float)
    return float((shown[mask].astype(float) - due[mask]) @ part / (part @ part))


def squared_error(one: Luma, other: Luma) -> float:
    """The mean over all pixels."""
    return float(numpy.square(numpy.subtract(one, other, dtype=numpy.int16), dtype=numpy.int32).mean())


def compare(shown: Recording, source: Recording, begin: int) -> Likeness:
    """`begin`: time of the first shown picture on the source's clock."""
    found = Likeness([], [])
    unlike: list[int] = []
    before: dict[int, Luma] = {}
    for index, time in enumerate(shown.times):
        at = source.at(time + begin)
        if at is None:
            found.wrong.append(index)
            continue
        near = [at + step * sign for step in STEPS for sign in (-1, 1)]
        wanted = [one for one in (at, *near) if 0 <= one < len(source.times)]
        before = {one: before[one] if one in before else source.luma(one)
                  for one in range(min(wanted), max(wanted) + 1)}
        picture, due = shown.luma(index), before[at]
        error = squared_error(picture, due)
        found.psnr.append(10 * math.log10(255 ** 2 / error) if error else PERFECT)
        places = {one: place(picture, due, before[one]) for one in wanted if one != at}
        nothing = error > max(ROUNDED, NOTHING * float(due.var()))
        if nothing or any(one is not None and one > OTHER for one in places.values()):
            unlike.append(index)
        next_to = [places[one] for one in (at - 1, at + 1) if one in places]
        found.told += bool(next_to) and all(one is not None and one < DUE for one in next_to)
    if found.legible:
        found.wrong = sorted(found.wrong + unlike)
    return found
