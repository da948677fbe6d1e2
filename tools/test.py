#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""make test: everything. test.py [WORDS]  only tests that match (pytest -k), without lint and the C tests.

Order: lint, the C tests of each build (meson), pytest (tests/host, and tests/boot with the development image), then
tests/boot with each image of the product that was built here. With BOARD= only tests/boot with that board's image.
"""
import os
import subprocess
import sys

import build
import buildroot
import lint
import machine
import native
from common import OUTPUT, TOP, Failed, say

SANITIZE = "-Db_lundef=false"  # the sanitizers' run time is found when a program starts
# Builds whose C tests are run: name, options for meson, packages. The first one goes into the image.
BUILDS: list[tuple[str, list[str], list[str]]] = [
    ("desk", [], native.PACKAGES),
    ("address", ["-Db_sanitize=address,undefined", SANITIZE], native.PACKAGES),
    ("thread", ["-Db_sanitize=thread", SANITIZE], ["ddx"]),
    ("m32", [f"-D{language}{what}=-m32" for language in ("c", "cpp") for what in ("_args", "_link_args")], ["ddx"]),
]


def c_tests() -> bool:
    good = True
    for name, options, packages in BUILDS:
        root = native.build(name, options, packages)
        for package in packages:
            say(f"C tests: {name}: {package}")
            done = subprocess.run(["meson", "test", "--no-rebuild", "--print-errorlogs", "-C", OUTPUT / name / package],
                                  env={**os.environ, **native.environment(root)}, check=False)
            good &= done.returncode == 0
    return good


def pytest(words: list[str], *folders: str, board: str = "") -> bool:
    command = ["/usr/bin/python3", "-B", "-m", "pytest", *(["-k", " ".join(words)] if words else []), *folders]
    return subprocess.run(command, cwd=TOP, env={**os.environ, "BOARD": board}, check=False).returncode == 0


def product(words: list[str]) -> bool:
    """The boards whose images are here; says which ones are not."""
    good, skipped = True, []
    for board in buildroot.boards():
        try:
            machine.image(board)
        except Failed as error:
            skipped.append(str(error))
            continue
        say(f"boot tests: {board}")
        good &= pytest(words, "tests/boot", board=board)
    for text in skipped:
        say(f"test: skipped: {text}")
    return good


def main() -> int:
    words, board = sys.argv[1:], os.environ.get("BOARD", "")
    try:
        good = True
        if board:
            if board != machine.DEV:
                machine.image(board)
            build.dev([native.build()])
            return 0 if pytest(words, "tests/boot", board=board) else 1
        if not words:
            good = lint.main() == 0
            good &= c_tests()
        build.dev([native.build()])
    except Failed as error:
        say(f"test: {error}")
        return 1
    good &= pytest(words)
    if not words:
        good &= product(words)
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
