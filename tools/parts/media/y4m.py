# SPDX-License-Identifier: GPL-2.0-or-later
"""A reader of Y4M files that shares no code with the programs under test."""
import dataclasses
import pathlib
from collections.abc import Iterator

# Divisors of width and height for the chroma planes
CHROMA = {"420": (2, 2), "420jpeg": (2, 2), "420mpeg2": (2, 2), "420paldv": (2, 2), "422": (2, 1), "444": (1, 1),
          "411": (4, 1)}


class Malformed(Exception):
    """A damaged file, or one that is not Y4M; the message begins with its name."""


@dataclasses.dataclass(frozen=True)
class Header:
    width: int
    height: int
    chroma: str
    parameters: tuple[str, ...]

    @property
    def planes(self) -> tuple[int, int]:
        """Bytes of the Y plane and of one chroma plane."""
        if self.chroma == "mono":
            return self.width * self.height, 0
        across, down = CHROMA[self.chroma]
        return self.width * self.height, -(-self.width // across) * -(-self.height // down)

    @property
    def frame_size(self) -> int:
        luma, chroma = self.planes
        return luma + 2 * chroma

    def value(self, key: str) -> str | None:
        return next((p[len(key):] for p in self.parameters if p.startswith(key)), None)


@dataclasses.dataclass(frozen=True)
class Frame:
    parameters: tuple[str, ...]
    data: bytes
    position: int = 0  # of the data in the file

    @property
    def start(self) -> int | None:
        """Time of capture of a recording's first frame, ns on the machine's monotonic clock."""
        return next((int(p[11:]) for p in self.parameters if p.startswith("XDDX_START=")), None)

    @property
    def time(self) -> int | None:
        """ns since the first frame, if the file has times."""
        return next((int(p[6:]) for p in self.parameters if p.startswith("XTIME=")), None)


def _header(line: bytes) -> Header:
    words = line.decode("ascii", "replace").split(" ")
    if words[0] != "YUV4MPEG2":
        raise Malformed("no Y4M file; make one: ffmpeg -i FILE -pix_fmt yuv420p OUT.y4m")
    values = {word[0]: word[1:] for word in words[1:] if word and word[0] in "WHC"}
    chroma = values.get("C", "420")
    if chroma not in CHROMA and chroma != "mono":
        raise Malformed(f"chroma layout {chroma}; convert it: ffmpeg -i FILE -pix_fmt yuv420p OUT.y4m")
    width, height = (int(text) if (text := values.get(key, "")).isdecimal() else 0 for key in "WH")
    if not width or not height:
        raise Malformed("width or height is missing or zero; the file is damaged")
    return Header(width, height, chroma, tuple(words[1:]))


def read(path: pathlib.Path) -> tuple[Header, Iterator[Frame]]:
    """The header and an iterator over the frames; an incomplete last frame raises Malformed."""
    file = path.open("rb")
    try:
        header = _header(file.readline(1024).rstrip(b"\n"))
    except Malformed as error:
        file.close()
        raise Malformed(f"{path.name}: {error}") from None

    def frames() -> Iterator[Frame]:
        number = 0
        with file:
            while line := file.readline(1024):
                words = line.rstrip(b"\n").decode("ascii", "replace").split(" ")
                position = file.tell()
                if words[0] != "FRAME" or not line.endswith(b"\n"):
                    raise Malformed(f"{path.name}: no FRAME line where frame {number} (from 0) should begin; "
                                    "the file is damaged from there on")
                data = file.read(header.frame_size)
                if len(data) != header.frame_size:
                    raise Malformed(f"{path.name}: cut short in frame {number} (from 0); "
                                    "the frames before it are whole")
                yield Frame(tuple(words[1:]), data, position)
                number += 1

    return header, frames()


def join(paths: list[pathlib.Path], into: pathlib.Path) -> None:
    """Join consecutive files: one header, and each frame's time since the first one."""
    begin: int | None = None
    with into.open("wb") as out:
        for path in paths:
            with path.open("rb") as file:
                line = file.readline(1024)
            if not out.tell():
                out.write(line)
                first = line
            elif line != first:
                raise Malformed(f"{path.name}: another header than {paths[0].name}")
            start = 0
            for frame in read(path)[1]:
                values = dict(parameter.partition("=")[::2] for parameter in frame.parameters)
                start = int(values.get("XDDX_START", start))
                begin = start if begin is None else begin
                if start and frame.time is not None:
                    values["XTIME"] = str(frame.time + start - begin)
                if start != begin:
                    values = {key: value for key, value in values.items() if key == "XTIME"}
                words = [f"{key}={value}" if value else key for key, value in values.items()]
                out.write(" ".join(["FRAME", *words]).encode() + b"\n" + frame.data)
