#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""make defects: put defects back one by one; the test that stands against each has to turn red, with its words.

defects.py [WORDS]...   only those whose names have all the words. What was found is in output/defects.json.
The product is built and tested in a copy of the tree, output/defects; this one stays as it is.
"""
import json
import pathlib
import re
import shutil
import subprocess
import sys

from parts.common import OUTPUT, TOP, Failed, alone, commit, finish, run, say
from parts.testing.known_defects import DEFECTS, Defect

TREE = OUTPUT / "defects/tree"
LIMIT = 900  # s; for the build and a test that may wait in vain


def copy_tree() -> None:
    """The files that git knows or would add; unchanged files keep their times, so little is built again."""
    names = run(["git", "-C", TOP, "ls-files", "-z", "--cached", "--others", "--exclude-standard"]).split("\0")
    listed = {name for name in names if name and (TOP / name).is_symlink() | (TOP / name).exists()}
    TREE.mkdir(parents=True, exist_ok=True)
    (TREE.parent / "files").write_text("\n".join(sorted(listed)) + "\n")
    # By content, and with the time of now: a file that goes back to its former contents has to be built again.
    run(["rsync", "-a", "--no-times", "--checksum", f"--files-from={TREE.parent / 'files'}", f"{TOP}/", f"{TREE}/"])
    output = TREE / "output"
    if not output.exists():
        output.mkdir()
        for name in ("cache", "accel"):  # what was downloaded, and built from that
            if (OUTPUT / name).exists():
                (output / name).symlink_to(OUTPUT / name)


def test(defect: Defect) -> tuple[int, str]:
    """Exit status and words of the test in the copy."""
    command = [sys.executable, "-B", "-m", "pytest", "--tier=gate", "-q", "-x", defect.test]
    if defect.test.startswith("C: "):
        command = [sys.executable, "-B", "tools/again.py", "-times", "1", "-c", defect.test.removeprefix("C: ")]
    try:
        done = subprocess.run(command, cwd=TREE, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                              stderr=subprocess.STDOUT, text=True, errors="replace", timeout=LIMIT, check=False)
    except subprocess.TimeoutExpired as error:
        raise Failed(f"{defect.name}: no end within {error.timeout:.0f} s") from None
    return done.returncode, done.stdout


def put_back(defect: Defect) -> str:
    """What the test says of the defect; empty if it notices nothing."""
    file = TREE / defect.file
    text = file.read_text()
    if text.count(defect.now) != 1:
        raise Failed(f"{defect.name}: {defect.file} has `{defect.now}` {text.count(defect.now)} times")
    file.write_text(text.replace(defect.now, defect.then))
    try:
        status, said = test(defect)
    finally:
        shutil.copy2(TOP / defect.file, file)
        file.touch()  # newer than what was built with the defect
    found = re.search(defect.words, said)
    if status != 1 or not found:
        sys.stdout.write("".join(said.splitlines(keepends=True)[-40:]))
        return ""
    marked = [line[1:].strip() for line in said.splitlines() if line.startswith("E ")]
    return next((line for line in marked if re.search(defect.words, line)), found[0])


def main() -> int:
    words = sys.argv[1:]
    chosen = [one for one in DEFECTS if all(word in one.name for word in words)]
    if not chosen:
        raise Failed("no defect of that name")
    results: dict[str, str] = {}
    with alone("defects", OUTPUT / "defects.lock"):
        copy_tree()
        for one in chosen:
            results[one.name] = put_back(one)
            say(f"{'noticed' if results[one.name] else 'NOT NOTICED'}  {one.name}: {results[one.name][:90]}")
    path: pathlib.Path = OUTPUT / "defects.json"
    path.write_text(json.dumps({"commit": commit(), "noticed": results}, indent=2) + "\n")
    missed = sum(not said for said in results.values())
    say(f"defects: {len(results) - missed} of {len(results)} noticed")
    return 1 if missed else 0


if __name__ == "__main__":
    finish("defects", main)
