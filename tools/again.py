#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""make again: run chosen tests many times, and count how often each failed and why.

again.py [-times N] [-load] [-c NAME]... [WORDS]
WORDS: tests in Python that match (pytest -k); -c: a C test by meson's name, such as 'crash at each point'; with
neither, the whole suite. -load keeps every processor busy meanwhile. Failed tests are not repeated. The counts and the
commit are also in output/again.json.
"""
import argparse
import collections
import json
import os
import subprocess
import sys

import build
from parts.common import OUTPUT, TOP, Failed, alone, commit, finish, say
from parts.image import native
from parts.testing import suite


def once(options: argparse.Namespace) -> list[suite.Test]:
    if not options.c and not options.words:
        subprocess.run([sys.executable, "-B", TOP / "tools/gate.py"], env={**os.environ, "STRICT": "1"}, check=False)
        return [suite.Test(**json.loads(line)) for line in suite.RESULTS.read_text().splitlines()]
    with alone("again", suite.LOCK):
        run = suite.Suite(strict=True)
        for name in options.c:
            run.meson_named(name)
        if options.words:
            run.pytest(options.words, [])
        return run.tests


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("-times", type=int, default=10)
    parser.add_argument("-load", action="store_true")
    parser.add_argument("-c", action="append", default=[])
    parser.add_argument("words", nargs="*")
    suite.leave_make()
    options = parser.parse_args()
    build.dev([native.build()]) if options.words else native.build()
    # Load at the tests' own priority: a test that waits for an event passes, a test that guesses a time fails.
    busy = [subprocess.Popen(["sh", "-c", "while :; do :; done"]) for _ in range(os.cpu_count() or 1)
            if options.load]
    passed: collections.Counter[str] = collections.Counter()
    failed: dict[str, collections.Counter[str]] = {}
    try:
        for number in range(1, options.times + 1):
            tests = once(options)
            if not tests:
                raise Failed("no test matches")
            for test in tests:
                if test.outcome == "failed":
                    failed.setdefault(test.name, collections.Counter())[suite.first_words(test.failure)] += 1
                else:
                    passed[test.name] += 1
            say(f"again: {number} of {options.times}: {sum(test.outcome == 'failed' for test in tests)} failed")
    finally:
        for process in busy:
            process.kill()
    for name, reasons in failed.items():
        say(f"{name}: failed {sum(reasons.values())} of {options.times}")
        for reason, count in reasons.items():
            say(f"  {count} x {reason}")
    result = {"commit": commit(), "times": options.times, "load": options.load, "words": options.words + options.c,
              "tests": len({*passed, *failed}), "failed": {name: dict(why) for name, why in failed.items()}}
    (OUTPUT / "again.json").write_text(json.dumps(result, indent=2) + "\n")
    say(f"again: {len(failed)} of {result['tests']} tests failed at least once in {options.times} runs")
    return 1 if failed else 0


if __name__ == "__main__":
    finish("again", main)
