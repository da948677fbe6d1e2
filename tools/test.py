#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""make test: everything. test.py [WORDS]  only tests that match (pytest -k), without lint and the C tests.

Order: lint, the C tests of each build (meson), then pytest (tests/host, tests/boot), whose summary is the last line.
"""
import os
import subprocess
import sys

import build
import native
import lint
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


def main() -> int:
    words = sys.argv[1:]
    try:
        good = True
        if not words:
            good = lint.main() == 0
            good &= c_tests()
        build.dev([native.build()])
    except Failed as error:
        say(f"test: {error}")
        return 1
    command = ["/usr/bin/python3", "-B", "-m", "pytest", *(["-k", " ".join(words)] if words else [])]
    pytest = subprocess.run(command, cwd=TOP, check=False)
    return 0 if good and pytest.returncode == 0 else 1


if __name__ == "__main__":
    sys.exit(main())
