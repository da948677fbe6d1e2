# SPDX-License-Identifier: GPL-2.0-or-later
"""The manual for `man`: a page for each program, from its -help, and for each call, from the headers' comments."""
import pathlib
import re

from parts.common import TOP, run
from parts.release import manual_calls, manual_programs

HEADERS = {"ddx": TOP / "package/ddx/include", "ddxvideo": TOP / "package/ddxvideo/include"}  # by their library
SEE = ["ddxctl", "ddxstore"]  # related to most programs
# Lets a program in Python print its help without a module that is not installed here.
STUB = "import runpy, sys, types; sys.modules['cv2'] = types.ModuleType('cv2'); sys.argv = sys.argv[1:]; " \
       "runpy.run_path(sys.argv[0], run_name='__main__')"


def release() -> str:
    found = re.search(r"version: '([\d.]+)'", (TOP / "package/ddx/meson.build").read_text())
    return f"DDXVIDEO {found[1] if found else ''}"


def help_text(program: pathlib.Path, environment: dict[str, str]) -> str:
    """A program's -help, for a terminal of 100 columns."""
    with program.open("rb") as file:
        script = b"python" in file.readline(64)
    python = ["/usr/bin/python3", "-B", "-c", STUB] if script else []
    return run([*python, program, "-help"], env={**environment, "COLUMNS": "100"})


def other_name(program: pathlib.Path) -> str:
    """The program beside this name to which it is a link, or ""."""
    to = str(program.readlink()) if program.is_symlink() else ""
    return to if "/" not in to else ""


def link(to: str) -> str:
    return f".so man{manual_programs.SECTION}/{to}.{manual_programs.SECTION}\n"


def of_programs(programs: list[pathlib.Path], environment: dict[str, str]) -> dict[str, str]:
    what = manual_programs.abouts(TOP / "package")
    return {program.name: link(other) if (other := other_name(program)) else
            manual_programs.program_page(program.name, what.get(program.name, ""), help_text(program, environment), SEE,
                                         release())
            for program in programs}


def of_calls() -> dict[str, str]:
    result: dict[str, str] = {}
    for library, folder in HEADERS.items():
        headers = {path.name: path.read_text() for path in sorted(folder.glob("*.h"))}
        result |= manual_calls.pages(headers, library, release())
    return result


def write(folder: pathlib.Path, programs: list[pathlib.Path], environment: dict[str, str]) -> None:
    """Write the pages below `folder`, usually share/man. In `environment` the programs find their libraries."""
    for section, pages in ((manual_programs.SECTION, of_programs(programs, environment)),
                           (manual_calls.SECTION, of_calls())):
        below = folder / f"man{section}"
        below.mkdir(parents=True, exist_ok=True)
        for name, text in pages.items():
            (below / f"{name}.{section}").write_text(text)
