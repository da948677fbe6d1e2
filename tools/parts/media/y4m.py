# SPDX-License-Identifier: GPL-2.0-or-later
"""Y4M from outside: a reader that shares nothing with the programs under test."""
import dataclasses
import pathlib
from collections.abc import Iterator

# samples of both chroma planes together for each luma sample, as a divisor of (width, height)
CHROMA = {"420": (2, 2), "420jpeg": (2, 2), "420mpeg2": (2, 2), "420paldv": (2, 2), "422": (2, 1), "444": (1, 1),
          "411": (4, 1)}


class Malformed(Exception):
    pass


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

    @property
    def time(self) -> int | None:
        """ns since the first frame, where the file says so."""
        return next((int(p[6:]) for p in self.parameters if p.startswith("XTIME=")), None)


def _header(line: bytes) -> Header:
    words = line.decode("ascii").split(" ")
    if words[0] != "YUV4MPEG2":
        raise Malformed("no Y4M file")
    values = {word[0]: word[1:] for word in words[1:] if word and word[0] in "WHC"}
    chroma = values.get("C", "420")
    if chroma not in CHROMA and chroma != "mono":
        raise Malformed(f"chroma layout {chroma}")
    return Header(int(values["W"]), int(values["H"]), chroma, tuple(words[1:]))


def read(path: pathlib.Path) -> tuple[Header, Iterator[Frame]]:
    """The header, and the frames one after the other. A cut-off last frame raises Malformed."""
    file = path.open("rb")
    header = _header(file.readline(1024).rstrip(b"\n"))

    def frames() -> Iterator[Frame]:
        with file:
            while line := file.readline(1024):
                words = line.rstrip(b"\n").decode("ascii").split(" ")
                data = file.read(header.frame_size)
                if words[0] != "FRAME" or not line.endswith(b"\n") or len(data) != header.frame_size:
                    raise Malformed("a frame is cut off or damaged")
                yield Frame(tuple(words[1:]), data)

    return header, frames()


def join(paths: list[pathlib.Path], into: pathlib.Path) -> None:
    """Files that follow each other as one: the header, and each frame's time since the first one."""
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
