# SPDX-License-Identifier: GPL-2.0-or-later
"""MP4 recordings, read by FFmpeg; only their outer boxes are read here."""
import pathlib
import struct
import subprocess
from collections.abc import Iterator

from parts.common import run
from parts.media.y4m import Malformed


def boxes(path: pathlib.Path) -> list[str]:
    """The outer boxes of a file. Malformed: they do not end with the file."""
    kinds, at, size = list[str](), 0, path.stat().st_size
    with path.open("rb") as file:
        while at < size:
            file.seek(at)
            begin = file.read(16).ljust(16, b"\0")
            length, kind, long = struct.unpack(">I4sQ", begin)
            kinds.append(kind.decode("latin-1"))
            at += length if length > 1 else long
            if length < 1 or at > size:
                raise Malformed(f"{path.name}: its boxes do not end with the file")
    return kinds


def size(path: pathlib.Path) -> tuple[int, int]:
    """Width and height of its pictures."""
    found = run(["ffprobe", "-v", "error", "-show_entries", "stream=width,height", "-of", "csv=p=0", path])
    width, height = map(int, found.strip().split(","))
    return width, height


def is_finished(path: pathlib.Path) -> bool:
    """Whether it is a plain file with a table, in which every player seeks."""
    return boxes(path) == ["ftyp", "mdat", "moov"]


def pictures(path: pathlib.Path, size: int) -> Iterator[bytes]:
    """Each decoded picture, 4:2:0, of `size` bytes. Malformed: FFmpeg reports an error."""
    with subprocess.Popen(["ffmpeg", "-nostdin", "-v", "error", "-i", path, "-fps_mode", "passthrough", "-pix_fmt",
                           "yuv420p", "-f", "rawvideo", "-"], stdout=subprocess.PIPE,
                          stderr=subprocess.PIPE) as player:
        assert player.stdout and player.stderr
        while len(data := player.stdout.read(size)) == size:
            yield data
        said = player.stderr.read()
    if player.returncode or said or data:
        raise Malformed(f"{path.name}: {said.decode(errors='replace') or 'cut short'}")
