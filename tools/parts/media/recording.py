# SPDX-License-Identifier: GPL-2.0-or-later
"""Extract a recording from the disk without the guest, and compare it with the clip."""
import dataclasses
import hashlib
import itertools
import pathlib
import re
import struct

from parts.common import Failed, run, scratch
from parts.disk import mbr
from parts.media import record_index, y4m
from parts.media.clip import frame_number

REC = 6  # the partition, see board/common/disk.cfg
FULL_420 = ["420", "420jpeg", "420mpeg2", "420paldv"]


class FileSystem:
    """A file system in a partition of a disk image, or in the whole image (None), read by debugfs without a mount."""

    def __init__(self, disk: pathlib.Path, number: int | None = REC) -> None:
        self.place = f"{disk}?offset={mbr.partition(disk, number).begin if number else 0}"

    def _debugfs(self, request: str) -> str:
        return run(["debugfs", "-R", request, self.place])

    def _files(self, folder: str) -> dict[str, int]:
        """Names and inodes of the files in a folder; empty if there is no such folder."""
        found = re.findall(r"^/(\d+)/10\d+/\d+/\d+/([^/]+)/", self._debugfs(f"ls -p {folder}"), re.M)
        return {name: int(inode) for inode, name in found}

    def names(self) -> list[str]:
        return sorted(self._files("/"))

    def take(self, name: str, into: pathlib.Path) -> pathlib.Path:
        self._debugfs(f'dump "/{name}" "{into}"')
        return into

    def _index(self, name: str) -> bytes:
        with scratch() as folder:
            return self.take(f"pool/{name}", folder / "index").read_bytes()

    def _session(self, name: str) -> int:
        magic, session = struct.unpack_from("<8s60xI", self._index(name))  # package/ddxvideo/save/pool/index.h
        if magic != b"DDXINDX1":
            raise Failed(f"/pool/{name} is no index")
        return int(session)

    def recordings(self, item: str = "") -> list[list[str]]:
        """Recordings, oldest first, each as the names of its consecutive files."""
        pool = {inode: name.replace(".y4m", ".index") for name, inode in self._files("/pool").items()
                if name.endswith(".y4m")}
        found: list[tuple[int, str, int]] = []  # number, name, number of the first file
        for name, inode in self._files("/").items():
            match = re.fullmatch(r"(.*)-(\d+)-\d+T\d+Z\.(?:y4m|mp4)", name)
            if match and item in ("", match[1]):
                number = int(match[2])
                found.append((number, name, self._session(pool[inode]) if inode in pool else number))
        found.sort()
        return [[name for _, name, _ in group] for _, group in itertools.groupby(found, lambda one: one[2])]

    def indexes(self) -> dict[str, record_index.Index]:
        """The index of each finished file of a recording, by name."""
        indexes = [self._index(name) for name in self._files("/pool") if name.endswith(".index")]
        found = [record_index.parse(data) for data in indexes if data[8] == record_index.NAMED]
        return {index.name: index for index in found}

    def lost(self) -> list[str]:
        """A line for each gap in the recordings, with the lost frames."""
        return [f"{name}: before frame {position}: {entry.lost_store} lost in the store, "
                f"{entry.lost_ring} in the ring, {entry.lost_encode} in the encoder"
                for name, index in sorted(self.indexes().items()) for position, entry in enumerate(index.entries)
                if entry.lost]

    def take_only(self, item: str, into: pathlib.Path) -> pathlib.Path:
        """Extract the only recording of an item ("": of any) into one file."""
        found = self.recordings(item)
        if len(found) != 1:
            raise Failed(f"one recording of {item or 'anything'} was expected, there are {found}")
        return self.take_all(found[0], into)

    def take_all(self, names: list[str], into: pathlib.Path) -> pathlib.Path:
        """Extract a recording into one file, with continuous times."""
        with scratch(into.parent) as folder:
            y4m.join([self.take(name, folder / name) for name in names], into)
        return into

    def features(self) -> list[str]:
        match = re.search(r"^Filesystem features:\s+(.*)$", self._debugfs("show_super_stats -h"), re.M)
        return match[1].split() if match else []


@dataclasses.dataclass
class Comparison:
    clip: int = 0  # frames in the clip
    recorded: int = 0  # frames in the recording
    missing: list[int] = dataclasses.field(default_factory=list)  # frames of the clip that the recording lacks
    foreign: list[int] = dataclasses.field(default_factory=list)  # frames of the recording that are not the next ones
    numbered: bool = False  # the pictures have numbers, which are compared as well
    exact: bool = True  # compared byte by byte; else only counted
    unordered: int = 0  # time stamps that do not rise


def compare(clip: pathlib.Path, recording: pathlib.Path) -> Comparison:
    """Compare the recording's frames with the clip's, in order, byte by byte."""
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
