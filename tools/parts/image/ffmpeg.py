# SPDX-License-Identifier: GPL-2.0-or-later
"""FFmpeg for the development image, from Debian's source package, with the parts that the product has.

The same version as Debian's libraries, which the programs are built with, so these take their place in the image:
Debian's own would bring 130 MB of libraries along. x264, which needs no other library, is Debian's.
"""
import os
import pathlib

from parts.common import TOP, run
from parts.image import foreign

# Half the processor time of the usual -O3. The pictures are the same, and the loops that take time are in assembly.
OPTIMIZE = "-O1"
CONFIG = TOP / "board/common/ffmpeg.config"
SOURCE = "ffmpeg"  # the name of Debian's source package


def options() -> list[str]:
    """The product's choice of parts: lines that configure understands."""
    lines = (line.split("#", 1)[0].split() for line in CONFIG.read_text().splitlines())
    return [word for words in lines for word in words]


def build(tree: pathlib.Path, sources: dict[str, pathlib.Path]) -> None:
    run(["./configure", f"--prefix={tree}/usr", "--enable-shared", "--disable-static",
         f"--optflags={OPTIMIZE}", *options()], cwd=sources["ffmpeg"])
    run(["make", f"-j{os.cpu_count()}", "install-libs"], cwd=sources["ffmpeg"])


def ffmpeg() -> pathlib.Path:
    """An install tree: usr/lib/*.so."""
    return foreign.built("FFmpeg", [SOURCE], [CONFIG, pathlib.Path(__file__)], build)
