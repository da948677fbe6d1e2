#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""make test: the gate. test.py [-long] [WORDS]   WORDS: only tests that match (pytest -k), without lint and C tests

Order: the C tests of each build (meson) with lint beside them, pytest (tests/host, tests/model, and tests/boot with the
development image), then tests/boot with each image of the product that was built here. With BOARD= only tests/boot
with that board's image. -long runs the tests that take minutes, instead of the others.

A test that fails is run once more, alone; if it passes then, it counts as passed and is told of at the end (FLAKY).
There is no second chance with STRICT=1, nor for a test whose failure speaks of a torn or lost frame or comes from a
sanitizer. What failing tests left behind is in output/test/failed, the outcome of all in output/test/results.
"""
import os
import shutil
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import build
import buildroot
from parts.common import OUTPUT, TOP, Failed, alone, commit, say
from parts.guest import machine
from parts.image import native
from parts.testing import suite
from parts.testing.suite import Test

SANITIZE = "-Db_lundef=false"  # the sanitizers' run time is found when a program starts
# Builds whose C tests are run: name, options for meson, packages. The first one goes into the image.
BUILDS: list[tuple[str, list[str], list[str]]] = [
    ("desk", [], native.PACKAGES),
    ("address", ["-Db_sanitize=address,undefined", SANITIZE], native.PACKAGES),
    ("thread", ["-Db_sanitize=thread", SANITIZE], ["ddx"]),
    ("m32", [f"-D{language}{what}=-m32" for language in ("c", "cpp") for what in ("_args", "_link_args")], ["ddx"]),
]
# Tests of the desk mostly wait for programs that wait for frames. The files run in this order; those of the models
# compute.
DESK = ["-n", "6", "--dist", "loadfile", "tests/model", "tests/host"]
# A guest that boots has one processor busy, and one that plays a clip waits for the next frame.
BOOT = ["-n", "2", "--dist", "loadgroup", "tests/boot"]
LIMIT = 15 * 60  # s; what `make test` may take on two quiet cores
LONGEST = 30     # s; what a test of the gate may take


def lint(run: suite.Suite) -> bool:
    """Whether it complains; all that it says is shown in one piece."""
    command = ["nice", "-n", "10", sys.executable, "-B", str(TOP / "tools/lint.py")]
    with run.part("lint"):
        done = subprocess.run(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                              text=True, check=False)
    say(done.stdout.rstrip())
    return done.returncode != 0


def lint_and_c_tests(run: suite.Suite) -> None:
    """C tests mostly wait for each other's processes, so lint and the builds that follow run at the same time."""
    with ThreadPoolExecutor(2) as others:
        bad = others.submit(lint, run)
        builds = [others.submit(native.build, *build) for build in BUILDS]
        for (name, _, packages), build in zip(BUILDS, builds):
            with run.part(f"build: {name}"):
                root = build.result()
            for package in packages:
                with run.part(f"C tests: {name}"):
                    run.meson(name, package, native.environment(root))
        if bad.result():
            run.tests.append(Test("lint", "failed", 0, "see above"))


def product(run: suite.Suite, words: list[str]) -> None:
    """The boards whose images are here; says which ones are not."""
    skipped = []
    for board in buildroot.boards():
        try:
            machine.image(board)
        except Failed as error:
            skipped.append(str(error))
            continue
        with run.part(f"boot tests: {board}"):
            run.pytest(words, BOOT, board)
    for text in skipped:
        say(f"test: skipped: {text}")


def all_tests(run: suite.Suite, words: list[str], board: str) -> None:
    if board:
        if board != machine.DEV:
            machine.image(board)
        with run.part("build: development image"):
            build.dev([native.build()])
        with run.part(f"boot tests: {board}"):
            run.pytest(words, BOOT, board)
        return
    if not words and not run.long:
        foreign = subprocess.Popen([sys.executable, "-B", TOP / "tools/build.py", "foreign"], stdin=subprocess.DEVNULL)
        try:
            lint_and_c_tests(run)
            with run.part("build: development image"):
                foreign.wait()
        finally:
            foreign.terminate()
    with run.part("build: development image"):
        build.dev([native.build()])
    if run.long:
        with run.part("long tests"):
            run.pytest(words, [])
    else:
        with run.part("tests on the desk"):
            run.pytest(words, DESK)
        with run.part("boot tests"):
            run.pytest(words, BOOT)
    if not words or run.long:
        product(run, words)


def main() -> int:
    words = sys.argv[1:]
    run = suite.Suite(long="-long" in words, strict=bool(os.environ.get("STRICT")))
    words = [word for word in words if word != "-long"]
    shutil.rmtree(suite.FAILED, ignore_errors=True)
    begin = time.monotonic()
    say(f"test: {commit()}")
    try:
        all_tests(run, words, os.environ.get("BOARD", ""))
    except Failed as error:
        say(f"test: {error}")
        return 1
    took = time.monotonic() - begin
    say(run.table())
    if not run.long and not words:
        if took > LIMIT:
            say(f"test: took {took / 60:.1f} minutes of {LIMIT // 60}: see the table for who")
        for test in run.tests:
            if test.seconds > LONGEST:
                say(f"test: {test.name} took {test.seconds:.0f} s of {LONGEST}: a short form here, the rest is `long`")
    return run.verdict(OUTPUT / "flaky.txt")


if __name__ == "__main__":
    with alone("test", suite.LOCK):
        sys.exit(main())
