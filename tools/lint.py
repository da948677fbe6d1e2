#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""Static checks: scripts (shellcheck), Python (mypy --strict), format of C (clang-format), length of lines, licence
lines, links, plain English, packages that the tools need, subjects of commits."""
import pathlib
import re
import subprocess
import sys
from collections.abc import Iterator

from parts.common import HOST_CACHE, TOP, alone, say
from parts.release import needs

SOURCES = ["*.c", "*.h", "*.py", "*.sh", "meson.build"]
PICTURES = (".png", ".jpg", ".svg", ".y4m", ".xz")  # no text
LONGEST = 120
# Commits before the formatting commit, which this file names, are not judged.
REFORMATTED = TOP / ".git-blame-ignore-revs"
AREAS = {"bench", "board", "catalog", "ci", "ddxctl", "docs", "draw", "examples", "grabber", "health", "image",
         "libddx", "logger", "panel", "player", "python", "recorder", "services", "stereo", "store", "stream", "tests",
         "tools", "video", "viewer"}
SUBJECT = 72  # characters

# Phrases that CONTRIBUTING.md rules out, with the reason.
PLAIN = [
    (r"(?<!\")\b(no|some|every)body\b|\bwhoever\b", "name the program or person"),
    (r"(^|[.,;:(] )who\b", "name the program or person before \"who\""),
    (r"\banew\b", "again"),
    (r"\bso many\b", "a number or a name"),
    (r"\btold of\b|\bis told\b", "gets, receives, reports"),
    (r"(/\*|^ \*|(?<!#)#|\"\"\") ?(?-i:What|Which|Who) ", "a noun instead of a clause without one"),
    (r"\bhas an? (ear|say|eye)\b|\bin the books?\b|\bby hand of\b", "no metaphors"),
]
# The rules themselves, the history, and names.
EXEMPT = ("CHANGELOG.md", "CONTRIBUTING.md", "board/dev/skeleton/", "package/ddxservice/merge.awk",
         "tests/host/test_sbom.py", "tools/lint.py", "tools/sbom.py")


def files() -> list[pathlib.Path]:
    """All files of the project, committed or not."""
    listed = subprocess.run(["git", "ls-files", "--cached", "--others", "--exclude-standard"], cwd=TOP,
                            capture_output=True, text=True, check=True).stdout
    return [TOP / name for name in listed.splitlines() if (TOP / name).is_file()]


def is_script(path: pathlib.Path) -> bool:
    with path.open("rb") as file:
        return file.readline(64).startswith(b"#!/bin/sh")


def layout(path: pathlib.Path, name: str, text: str) -> Iterator[str]:
    """Lines that are too long, and a missing licence line."""
    lines = text.splitlines()
    code = is_script(path) or any(path.match(pattern) for pattern in SOURCES)
    page = path.suffix == ".md" and not name.startswith(EXEMPT)
    for number, line in enumerate(lines, 1):
        prose = page and not line.startswith(("|", "    ", "!["))  # rows of tables, code and pictures cannot be wrapped
        if (code or prose) and len(line.expandtabs(4)) > LONGEST:
            yield f"{name}:{number}: longer than {LONGEST}"
    if path.suffix in (".c", ".h", ".py") and "SPDX-License-Identifier" not in "".join(lines[:3]):
        yield f"{name}: no SPDX-License-Identifier at its top"


def dead_links(path: pathlib.Path, name: str, text: str) -> Iterator[str]:
    """Links of a page to files that do not exist."""
    for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", text) if path.suffix == ".md" else []:
        if not (path.parent / target).exists():
            yield f"{name}: the link to {target} leads nowhere"


def phrases(name: str, text: str) -> Iterator[str]:
    """Lines with a phrase that is ruled out."""
    if name.startswith(EXEMPT) or "LICENSE" in name:
        return
    for number, line in enumerate(text.splitlines(), 1):
        for pattern, instead in PLAIN:
            if match := re.search(pattern, line, re.IGNORECASE):
                yield f"{name}:{number}: {match[0].strip()!r}: {instead}"


def types_fit() -> bool:
    """Whether mypy has no complaint. It keeps what it read for all clones: relative names are the same in each."""
    python = [TOP / "tools", TOP / "package/ddx/python", TOP / "package/ddxvideo/stereo", TOP / "bench",
              TOP / "examples", *sorted((TOP / "tests").glob("*"))]
    folders = [path.relative_to(TOP) for path in python if list(path.glob("*.py"))]
    mypy = ["/usr/bin/python3", "-m", "mypy", "--strict", "--no-error-summary", f"--cache-dir={HOST_CACHE / 'mypy'}"]
    with alone("lint", HOST_CACHE / "mypy.lock"):
        env = {"MYPYPATH": "tools:tests:package/ddx/python", "PATH": "/usr/bin:/bin"}
        return subprocess.run([*mypy, *folders], cwd=TOP, check=False, env=env).returncode == 0


def commits() -> Iterator[str]:
    """Subjects that are too wide, or whose area is unknown. Nothing, where the history is not complete."""
    first = [line for line in REFORMATTED.read_text().split() if re.fullmatch("[0-9a-f]{40}", line)][-1]
    found = subprocess.run(["git", "log", "--no-merges", "--format=%h %s", f"{first}..HEAD"], cwd=TOP,
                           capture_output=True, text=True, check=False)
    for line in found.stdout.splitlines():
        name, subject = line.split(" ", 1)
        areas = subject.partition(": ")[0].split(", ") if ": " in subject else []
        if len(subject) > SUBJECT:
            yield f"commit {name}: {len(subject)} characters in the subject, at most {SUBJECT}"
        if not areas or set(areas) - AREAS:
            yield f"commit {name}: \"{subject}\" does not begin with an area: {', '.join(sorted(AREAS))}"


def main() -> int:
    paths, failed = files(), False
    for path in paths:
        if path.suffix in PICTURES:
            continue
        name, text = str(path.relative_to(TOP)), path.read_text(errors="replace")
        for complaint in (*layout(path, name, text), *dead_links(path, name, text), *phrases(name, text)):
            say(complaint)
            failed = True
    for complaint in needs.complaints(needs.parts()):
        say(complaint)
        failed = True
    for complaint in commits():
        say(complaint)
        failed = True
    sources = [path for path in paths if path.suffix in (".c", ".h")]
    failed |= subprocess.run(["clang-format", "--dry-run", "--Werror", *sources], check=False).returncode != 0
    scripts = [path for path in paths if is_script(path)]
    failed |= subprocess.run(["shellcheck", "--shell=sh", *scripts], check=False).returncode != 0
    failed |= not types_fit()
    say("lint: failed" if failed else f"lint: {len(scripts)} scripts and {len(paths)} files are fine")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
