# SPDX-License-Identifier: GPL-2.0-or-later
"""The programs of tests/guest, which run inside a guest."""
import pathlib
from collections.abc import Sequence

from parts.common import TOP, run
from parts.guest import machine

SOURCES = TOP / "tests/guest"


def build(name: str, folder: pathlib.Path, board: str, words: Sequence[str] = ()) -> pathlib.Path:
    """Build SOURCES/NAME as a static program for the board's processor, with more words for the compiler."""
    bits = ["-m32", "-D_FILE_OFFSET_BITS=64", "-D_TIME_BITS=64"] if "i386" in machine.meta(board)["qemu"] else []
    run(["gcc", "-static", "-std=gnu11", "-O2", "-Wall", "-Wextra", "-Werror", "-pthread", "-D_GNU_SOURCE", *bits,
         *sorted((SOURCES / name).glob("*.c")), *words, "-o", folder / name])
    return folder / name
