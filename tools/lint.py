#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""Checks without running anything: scripts (shellcheck), tools (mypy --strict), length of lines, licence lines,
links of pages, plain English."""
import pathlib
import re
import subprocess
import sys

from parts.common import TOP, say

SOURCES = ["*.c", "*.h", "*.py", "*.sh", "meson.build"]
LONGEST = 120

# Phrases that CONTRIBUTING.md rules out, with the reason.
PLAIN = [
    (r"\b(no|some|every)body\b|\bwhoever\b", "name the program or person"),
    (r"(^|[.,;:(] )who\b", "name the program or person before \"who\""),
    (r"\banew\b", "again"),
    (r"\bso many\b", "a number or a name"),
    (r"\btold of\b|\bis told\b", "gets, receives, reports"),
    (r"\bhas an? (ear|say|eye)\b|\bin the books?\b|\bby hand of\b", "no metaphors"),
]
# The rules themselves, the history, and names.
EXEMPT = ("CHANGELOG.md", "CONTRIBUTING.md", "board/dev/skeleton/", "package/ddxservice/merge.awk",
         "tests/host/test_sbom.py", "tools/lint.py", "tools/sbom.py")


def files() -> list[pathlib.Path]:
    """Everything of the project, committed or not yet."""
    listed = subprocess.run(["git", "ls-files", "--cached", "--others", "--exclude-standard"], cwd=TOP,
                            capture_output=True, text=True, check=True).stdout
    return [TOP / name for name in listed.splitlines() if (TOP / name).is_file()]


def is_script(path: pathlib.Path) -> bool:
    with path.open("rb") as file:
        return file.readline(64).startswith(b"#!/bin/sh")


def complaints(paths: list[pathlib.Path]) -> list[str]:
    found = []
    for path in paths:
        script = is_script(path)
        if not script and not any(path.match(pattern) for pattern in SOURCES):
            continue
        lines = path.read_text(errors="replace").splitlines()
        name = path.relative_to(TOP)
        found += [f"{name}:{number}: longer than {LONGEST}" for number, line in enumerate(lines, 1)
                  if len(line.expandtabs(4)) > LONGEST]
        if path.suffix in (".c", ".h", ".py") and "SPDX-License-Identifier" not in "".join(lines[:3]):
            found.append(f"{name}: no SPDX-License-Identifier at its top")
    return found


def dead_links(paths: list[pathlib.Path]) -> list[str]:
    """Links of pages to files that are not there."""
    found = []
    for path in paths:
        if path.suffix != ".md":
            continue
        for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", path.read_text()):
            if not (path.parent / target).exists():
                found.append(f"{path.relative_to(TOP)}: the link to {target} leads nowhere")
    return found


def is_prose(line: str) -> bool:
    """Whether a page's line can be wrapped: rows of tables and code cannot."""
    return not line.startswith(("|", "    ", "!["))


def long_prose(paths: list[pathlib.Path]) -> list[str]:
    found = []
    for path in paths:
        name = str(path.relative_to(TOP))
        if path.suffix == ".md" and not name.startswith(EXEMPT):
            lines = path.read_text().splitlines()
            found += [f"{name}:{number}: longer than {LONGEST}" for number, line in enumerate(lines, 1)
                      if is_prose(line) and len(line) > LONGEST]
    return found


def phrases(paths: list[pathlib.Path]) -> list[str]:
    """Lines with a phrase that is ruled out."""
    found = []
    for path in paths:
        name = str(path.relative_to(TOP))
        if name.startswith(EXEMPT) or "LICENSE" in name or path.suffix in (".png", ".jpg", ".svg", ".y4m", ".xz"):
            continue
        for number, line in enumerate(path.read_text(errors="replace").splitlines(), 1):
            found += [f"{name}:{number}: {match[0].strip()!r}: {instead}" for pattern, instead in PLAIN
                      if (match := re.search(pattern, line, re.IGNORECASE))]
    return found


def main() -> int:
    paths = files()
    bad = complaints(paths) + dead_links(paths) + long_prose(paths) + phrases(paths)
    for text in bad:
        say(text)
    failed = bool(bad)
    scripts = [path for path in paths if is_script(path)]
    failed |= subprocess.run(["shellcheck", "--shell=sh", *scripts], check=False).returncode != 0
    python = [TOP / "tools", TOP / "package/ddx/python", TOP / "package/ddxvideo/stereo", TOP / "examples",
              *sorted((TOP / "tests").glob("*"))]
    folders = [path for path in python if list(path.glob("*.py"))]
    for folder in folders:
        mypy = ["/usr/bin/python3", "-m", "mypy", "--strict", "--no-error-summary", f"--cache-dir={TOP}/output/mypy"]
        failed |= subprocess.run([*mypy, folder], cwd=TOP, check=False,
                                 env={"MYPYPATH": f"{TOP}/tools:{TOP}/package/ddx/python",
                                      "PATH": "/usr/bin:/bin"}).returncode != 0
    say("lint: failed" if failed else f"lint: {len(scripts)} scripts and {len(paths)} files are fine")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
