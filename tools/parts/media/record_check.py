# SPDX-License-Identifier: GPL-2.0-or-later
"""Frames of a looped clip that were lost: counted by the numbers in the recorded pictures, and compared with the index
and the programs' counters, which are independent of each other."""
import dataclasses
import pathlib
from collections.abc import Iterable, Iterator

import numpy

from parts.common import MEMORY, scratch
from parts.media import mp4, y4m
from parts.media.clip import HEIGHT, WIDTH, frame_number
from parts.media.counters import Counters, adds_up, agree
from parts.media.recording import FileSystem


@dataclasses.dataclass
class Found:
    published: int = 0  # frames written into the store, by the source's counter
    recorded: int = 0   # pictures on the disk
    lost: int = 0       # missing pictures, by their numbers
    longest: int = 0    # missing pictures in a row, at most
    wrong: int = 0      # pictures that contradict the index
    counted: dict[str, int] = dataclasses.field(default_factory=dict)  # lost, by the recorder's counters
    disagreements: list[str] = dataclasses.field(default_factory=list)


def numbers_lost(found: Found, numbers: Iterable[int | None], clip: int) -> None:
    """Count pictures and gaps; a gap is shorter than the clip."""
    last = -1
    for number in numbers:
        found.recorded += 1
        if number is None:
            found.wrong += 1
            last = (last + 1) % clip
            continue
        gap = (number - last - 1) % clip
        found.lost += gap
        found.longest = max(found.longest, gap)
        last = number
    behind = (found.published - 1 - last) % clip if found.recorded else found.published
    found.lost += behind
    found.longest = max(found.longest, behind)


def _shown(path: pathlib.Path, coded: bool) -> Iterator[int | None]:
    """The numbers in a file's pictures."""
    if coded:
        width, height = mp4.size(path)
        return (frame_number(data, width, height) for data in mp4.pictures(path, width * height * 3 // 2))
    header, frames = y4m.read(path)
    return (frame_number(frame.data, header.width, header.height) for frame in frames)


def _numbers(disk: FileSystem, found: Found, clip: int) -> Iterable[int | None]:
    """The numbers in all pictures, file by file; compares each with its entry in the index."""
    with scratch(MEMORY) as folder:
        indexes = disk.indexes()
        last = lost = 0
        for file in [file for recording in disk.recordings("video") for file in recording]:
            index = indexes[file]
            path = disk.take(file, folder / "file")
            agree(found.disagreements, f"{file}: bytes", path.stat().st_size, index.bytes)
            pictures = list(_shown(path, file.endswith(".mp4")))
            agree(found.disagreements, f"{file}: pictures", len(pictures), len(index.entries))
            for picture, entry in zip(pictures, index.entries):
                found.wrong += picture is None or picture % clip != (entry.sequence - 1) % clip
                agree(found.disagreements, f"{file}: lost before frame {entry.sequence}, by its entry",
                      entry.sequence - last - 1, entry.lost)
                last = entry.sequence
            lost += index.lost
            yield from pictures
    agree(found.disagreements, "lost, by the headers of the index", found.published - found.recorded, lost)


def recorder(image: pathlib.Path, load: Counters, save: Counters, clip: int) -> Found:
    """Check the recorder's files on an unmounted disk. The clip has `clip` frames."""
    found = Found(published=load.out, counted=dict(save.lost))
    numbers_lost(found, _numbers(FileSystem(image, None), found, clip), clip)
    for what, ours, theirs in [("published and received", load.out, save.frames_in),
                               ("pictures", found.recorded, save.out),
                               ("missing pictures", found.lost, save.lost_total),
                               ("published", found.recorded + found.lost, load.out)]:
        agree(found.disagreements, what, ours, theirs)
    adds_up(found.disagreements, load, save)
    return found


def naive(image: pathlib.Path, name: str, load: Counters, written: int, missed: int, clip: int) -> Found:
    """Check the file of tests/guest/naive."""
    found = Found(published=load.out, counted={"store": missed})
    size = WIDTH * HEIGHT * 3 // 2
    with scratch(MEMORY) as folder:
        data = numpy.memmap(FileSystem(image, None).take(name, folder / "file"), numpy.uint8, "r")
        numbers_lost(found, (frame_number(data[at:at + size].tobytes(), WIDTH, HEIGHT)
                             for at in range(0, len(data), size)), clip)
    for what, ours, theirs in [("pictures", found.recorded, written), ("missing pictures", found.lost, missed),
                               ("published", found.recorded + found.lost, load.out)]:
        agree(found.disagreements, what, ours, theirs)
    return found
