#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""make defects: apply each patch of tests/defects; its tests must fail with the expected message.

defects.py [WORDS]...   only patches whose name or first line has all the words. The result is output/defects.json.
A defect with a switch is compiled into test programs in output/desk. Each other patch is applied to a copy of the tree,
output/defects, where the product is built and tested.
"""
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys

import fuzz
from parts.common import MORTAL, OUTPUT, TOP, Failed, alone, commit, finish, run, say, scratch
from parts.defects import DEFECTS, Defect, plant
from parts.image import native
from parts.testing.suite import FRAMES_BROKEN

TREE = OUTPUT / "defects/tree"
DESK = OUTPUT / "desk"
LIMIT = 900  # s; for the build and a test that may wait in vain
ATTEMPTS = 3  # some defects show only at a certain timing, which a busy machine may miss


def copy_tree() -> None:
    """Copy the files that git tracks or would add; unchanged files keep their times, so little is built again."""
    names = run(["git", "-C", TOP, "ls-files", "-z", "--cached", "--others", "--exclude-standard"]).split("\0")
    listed = {name for name in names if name and (TOP / name).is_symlink() | (TOP / name).exists()}
    TREE.mkdir(parents=True, exist_ok=True)
    (TREE.parent / "files").write_text("\n".join(sorted(listed)) + "\n")
    # A changed file gets the present time, so that it is built again, also with its former content.
    run(["rsync", "-a", "--no-times", "--checksum", f"--files-from={TREE.parent / 'files'}", f"{TOP}/", f"{TREE}/"])
    for patch in (TREE / "tests/defects").glob("*.patch"):  # a build there would apply it
        if str(patch.relative_to(TREE)) not in listed:
            patch.unlink()
    output = TREE / "output"
    if not output.exists():
        output.mkdir()
        for name in ("cache", "accel"):  # downloads and what was built from them
            if (OUTPUT / name).exists():
                (output / name).symlink_to(OUTPUT / name)


def command(test: str) -> list[str]:
    if test.startswith("C: "):
        return [sys.executable, "-B", "tools/again.py", "-times", "1", "-c", test.removeprefix("C: ")]
    if ".py" in test:
        return [sys.executable, "-B", "-m", "pytest", "--tier=gate", "-q", "-x", test]
    program, *words = test.split()
    return [*MORTAL, str(DESK / program), *words]


def red(defect: Defect, test: str) -> str:
    """The output of a test that failed with the defect; else empty."""
    if test.startswith("fuzz: "):
        with scratch() as folder:
            fine, said = fuzz.fuzz(test.removeprefix("fuzz: "), 60, defect.name, corpus=folder)
            return "" if fine else said
    switch = {"DDX_BROKEN": defect.name, "DDX_STORE_PROGRAM": str(DESK / "ddx/tests/store-with-faults")}
    try:
        done = subprocess.run(command(test), cwd=None if defect.switched else TREE, stdin=subprocess.DEVNULL,
                              env={**os.environ, **(switch if defect.switched else {})}, stdout=subprocess.PIPE,
                              stderr=subprocess.STDOUT, text=True, errors="replace", timeout=LIMIT, check=False)
    except subprocess.TimeoutExpired as error:
        raise Failed(f"{defect.name}: no end within {error.timeout:.0f} s") from None
    return done.stdout if done.returncode in (1, FRAMES_BROKEN) else ""


def noticed(defect: Defect, test: str, words: str) -> str:
    """The test's message about the applied defect; empty if the test does not notice it."""
    for _ in range(ATTEMPTS if defect.switched else 1):
        said = red(defect, test)
        if found := re.search(words, said):
            marked = [line[1:].strip() for line in said.splitlines() if line.startswith("E ")]
            return next((line for line in marked if re.search(words, line)), found[0].splitlines()[0])
        sys.stdout.write("".join(said.splitlines(keepends=True)[-40:]))
    return ""


def put_back(defect: Defect) -> list[str]:
    """Apply a defect, and run its tests: the message of each."""
    if not defect.switched:
        plant(defect, TREE)
    try:
        found = [noticed(defect, test, words) for test, words in defect.tests]
    finally:
        for name in defect.files if not defect.switched else []:
            shutil.copy2(TOP / name, TREE / name)
            (TREE / name).touch()  # newer than what was built with the defect
    say(f"{'noticed' if all(found) else 'NOT NOTICED'}  {defect.name}: {'; '.join(found)[:90]}")
    return found


def main() -> int:
    chosen = [one for one in DEFECTS if one.tests and
              all(word.lower() in f"{one.name} {one.title}".lower() for word in sys.argv[1:])]
    if not chosen:
        raise Failed("no defect of that name")
    with alone("defects", OUTPUT / "defects.lock"):
        if any(one.switched for one in chosen):
            native.build()
        if not all(one.switched for one in chosen):
            copy_tree()
        results = {one.name: put_back(one) for one in chosen}
    path: pathlib.Path = OUTPUT / "defects.json"
    path.write_text(json.dumps({"commit": commit(), "noticed": results}, indent=2) + "\n")
    missed = sum(not all(found) for found in results.values())
    say(f"defects: {len(results) - missed} of {len(results)} noticed")
    return 1 if missed else 0


if __name__ == "__main__":
    finish("defects", main)
