#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""make test: the gate. gate.py [-long] [-junit FILE] [WORDS]
WORDS: only tests that match (pytest -k), without lint and C tests

Order: lint and the C tests (meson) of the desk build at the same time; pytest with tests/model and tests/host, and at
the same time the C tests of the other builds; tests/boot with the development image, then with each product image that
was built here. With BOARD= only tests/boot with that board's image. -long runs only the tests that take minutes.

A failed test is run again, alone; if it then passes, it counts as passed and is listed at the end (FLAKY). Not run
again are: any test with STRICT=1, an assertion in a test marked `strict`, a C test that exits with FRAMES_BROKEN, and a
sanitizer's report. Output of failed tests is in output/test/failed, all outcomes in output/test/results, and in FILE
as JUnit XML.
"""
import argparse
import contextlib
import os
import pathlib
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor

import build
import buildroot
from parts import trees
from parts.common import OUTPUT, TOP, Failed, alone, commit, say
from parts.guest import machine
from parts.image import native, tables
from parts.testing import junit, suite
from parts.testing.suite import Test

# Programs find the sanitizers' runtime when they start. The optimiser is what makes these builds slow, and it can only
# remove an access that a sanitizer would report.
SANITIZE = ["-Db_lundef=false", "-Doptimization=1"]
Build = tuple[str, list[str], list[str] | None]  # name, options for meson, packages (None: all)
# Builds with C tests. The first one goes into the image.
BUILDS: list[Build] = [
    ("desk", [], None),
    ("address", ["-Db_sanitize=address,undefined", *SANITIZE], None),
    ("thread", ["-Db_sanitize=thread", *SANITIZE], ["ddx"]),
    ("m32", [f"-D{language}{what}=-m32" for language in ("c", "cpp") for what in ("_args", "_link_args")], ["ddx"]),
]
# Host tests mostly wait for frames, model tests compute. The files run in this order.
DESK = ["-n", "5", "--dist", "loadfile", "tests/model", "tests/host"]
# A booting guest keeps one processor busy; a guest that plays a clip mostly waits for frames.
BOOT = ["-n", "2", "--dist", "loadgroup", "tests/boot"]
LIMIT = 15 * 60  # s; what `make test` may take on two quiet cores
LONGEST = 30     # s; what a test of the gate may take


def lint(run: suite.Suite) -> None:
    """Run lint; its output is printed in one piece."""
    command = [*suite.NICE, sys.executable, "-B", str(TOP / "tools/lint.py")]
    begin = time.monotonic()
    with run.part("lint"):
        done = subprocess.run(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                              text=True, check=False)
    say(done.stdout.rstrip())
    seconds = round(time.monotonic() - begin, 2)
    run.take([Test("lint", "failed", seconds, done.stdout) if done.returncode else Test("lint", "passed", seconds)])


def c_tests(run: suite.Suite, build: Build, made: "Future[pathlib.Path]") -> None:
    """The C tests of a build, when it is finished."""
    name, _, packages = build
    with run.part(f"build: {name}"):
        root = made.result()
    for package in packages or native.packages():
        with run.part(f"C tests: {name}"):
            run.meson(name, package, native.environment(root), beside=build is not BUILDS[0])


@contextlib.contextmanager
def lint_and_c_tests(run: suite.Suite) -> Iterator[None]:
    """Run lint and the next builds beside the first build's C tests, which mostly wait for processes, and the C tests
    of the other builds beside the caller's tests."""
    with ThreadPoolExecutor(2) as others, ThreadPoolExecutor(1) as tester:
        linted = others.submit(lint, run)
        made = [others.submit(native.build, *build) for build in BUILDS]
        tested = [tester.submit(c_tests, run, *pair) for pair in zip(BUILDS, made)]
        foreign = subprocess.Popen([sys.executable, "-B", TOP / "tools/build.py", "foreign"], stdin=subprocess.DEVNULL)
        try:
            tested[0].result()
            with run.part("build: development image"):
                foreign.wait()
        finally:
            foreign.terminate()
        yield
        for one in tested:
            one.result()
        linted.result()


def product(run: suite.Suite, words: list[str]) -> None:
    """Boot tests of the boards whose images were built here; others count as skipped."""
    skipped = []
    for board in buildroot.boards():
        try:
            machine.image(board)
        except Failed as error:
            skipped.append(Test(f"{board}: tests/boot", "skipped", 0.0, reason=str(error)))
            continue
        with run.part(f"boot tests: {board}"):
            run.pytest(words, BOOT, board)
    run.take(skipped)


def all_tests(run: suite.Suite, words: list[str], board: str) -> None:
    tables.programs()  # refuses contradictory trees before anything is built
    if board:
        if board != machine.DEV:
            machine.image(board)
        with run.part("build: development image"):
            build.dev([native.build()])
        with run.part(f"boot tests: {board}"):
            run.pytest(words, BOOT, board)
        return
    with lint_and_c_tests(run) if not words and not run.long else contextlib.nullcontext():
        with run.part("build: development image"):
            build.dev([native.build()])
        if run.long:
            with run.part("long tests"):
                run.pytest(words, [])
        else:
            with run.part("tests on the desk"):
                run.pytest(words, DESK)
    if not run.long:
        with run.part("boot tests"):
            run.pytest(words, BOOT)
    if not words or run.long:
        product(run, words)


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("-long", action="store_true")
    parser.add_argument("-junit", type=junit.target)
    parser.add_argument("words", nargs="*")
    suite.leave_make()
    options = parser.parse_args()
    words: list[str] = options.words
    run = suite.Suite(long=options.long, strict=bool(os.environ.get("STRICT")))
    shutil.rmtree(suite.FAILED, ignore_errors=True)
    begin = time.monotonic()
    os.environ["DDX_COMMIT"] = commit()
    os.environ["SERIAL"] = trees.serial()
    say(f"test: {commit()}")
    try:
        with junit.written(options.junit, run):
            all_tests(run, words, os.environ.get("BOARD", ""))
    except Failed as error:
        say(f"test: {error}")
        return error.status
    took = time.monotonic() - begin
    say(run.table())
    if not run.long and not words:
        if took > LIMIT:
            say(f"test: took {took / 60:.1f} minutes of {LIMIT // 60}: see the table above")
        for test in run.tests:
            if test.seconds > LONGEST and test.name != "lint":
                say(f"test: {test.name} took {test.seconds:.0f} s of {LONGEST}: a short form here, the rest is `long`")
    return run.verdict(OUTPUT / "flaky.txt")


if __name__ == "__main__":
    with alone("test", suite.LOCK):
        sys.exit(main())
