# SPDX-License-Identifier: GPL-2.0-or-later
"""The outside view of a recording: taken out of the disk without the guest's help, compared with the clip."""
import dataclasses
import hashlib
import pathlib
import re

import mbr
import y4m
from clip import frame_number
from common import Failed, run

REC = 6  # the partition, see board/common/disk.cfg
FULL_420 = ["420", "420jpeg", "420mpeg2", "420paldv"]


class Partition:
    """A file system inside a disk image, through debugfs: needs neither root nor a mount."""

    def __init__(self, disk: pathlib.Path, number: int = REC) -> None:
        self.place = f"{disk}?offset={mbr.partition(disk, number).begin}"

    def _debugfs(self, request: str) -> str:
        return run(["debugfs", "-R", request, self.place])

    def names(self) -> list[str]:
        found = re.findall(r"^/\d+/10\d+/\d+/\d+/([^/]+)/", self._debugfs("ls -p /"), re.M)
        return sorted(found)

    def take(self, name: str, into: pathlib.Path) -> pathlib.Path:
        self._debugfs(f'dump "/{name}" "{into}"')
        return into

    def features(self) -> list[str]:
        match = re.search(r"^Filesystem features:\s+(.*)$", self._debugfs("show_super_stats -h"), re.M)
        return match[1].split() if match else []


@dataclasses.dataclass
class Comparison:
    clip: int = 0  # frames in the clip
    recorded: int = 0  # frames in the recording
    missing: list[int] = dataclasses.field(default_factory=list)  # frames of the clip that the recording lacks
    foreign: list[int] = dataclasses.field(default_factory=list)  # frames of the recording that are not the clip's next
    numbered: bool = False  # the pictures carry numbers, and these agree as well
    exact: bool = True  # compared byte by byte (else: counted only)
    unordered: int = 0  # time stamps that do not rise


def compare(clip: pathlib.Path, recording: pathlib.Path) -> Comparison:
    """Are the recording's frames the clip's, in its order, byte by byte?"""
    result = Comparison()
    header, frames = y4m.read(clip)
    recorded_header, recorded_frames = y4m.read(recording)
    result.exact = header.chroma in FULL_420
    if (header.width, header.height) != (recorded_header.width, recorded_header.height):
        raise Failed(f"recorded {recorded_header.width}x{recorded_header.height}, not {header.width}x{header.height}")

    digests: list[bytes] = []
    numbers: list[int | None] = []
    for frame in frames:
        digests.append(hashlib.blake2b(frame.data).digest())
        numbers.append(frame_number(frame.data, header.width, header.height))
    result.clip = len(digests)
    result.numbered = numbers == list(range(result.clip))

    expected, last = 0, -1
    for index, frame in enumerate(recorded_frames):
        result.recorded += 1
        if frame.time is None or frame.time <= last:
            result.unordered += 1
        last = frame.time if frame.time is not None else last
        if not result.exact:
            continue
        try:
            found = digests.index(hashlib.blake2b(frame.data).digest(), expected)
        except ValueError:
            result.foreign.append(index)
            continue
        if result.numbered and frame_number(frame.data, header.width, header.height) != found:
            result.foreign.append(index)
            continue
        result.missing += range(expected, found)
        expected = found + 1
    if result.exact:
        result.missing += range(expected, result.clip)
    return result
