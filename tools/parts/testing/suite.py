# SPDX-License-Identifier: GPL-2.0-or-later
"""A run of the tests: its parts, second runs of failed tests, and a table and a verdict at the end."""
import contextlib
import dataclasses
import json
import os
import pathlib
import re
import resource
import subprocess
import threading
import time
from collections.abc import Iterator, Mapping, Sequence

from parts import trees
from parts.common import OUTPUT, TOP, output, say
from parts.image import native

TEST = OUTPUT / "test"
FAILED = TEST / "failed"
RESULTS = TEST / "results"
LOCK = OUTPUT / "test.lock"  # two runs in one clone would test each other's programs
SLOWEST = 15
NICE = ("nice", "-n", "10")
BESIDE = ("nice", "-n", "4")  # C tests beside others: with 10 a store did not answer within 5 s
C_TESTS = 4  # at a time: they mostly wait for processes
PATIENT = 4  # factor for the limits in meson.build: a C test may wait for a processor
LIMIT = 45 * 60  # s; of the gate's tests in Python, after which those that hang are named
FRAMES_BROKEN = 3  # exit status of a C test, see tests/unit/check.h
SANITIZERS = ("ASAN_OPTIONS", "TSAN_OPTIONS", "UBSAN_OPTIONS")
# Words of the Makefile that are options of the tools, not environment.
WORDS_OF_MAKE = ("ARGS", "BEFORE", "C", "CASES", "CLIP", "JUNIT", "LOAD", "ROUNDS", "T", "TIMES")


@dataclasses.dataclass
class Test:
    name: str
    outcome: str  # passed, failed, skipped, flaky
    seconds: float
    failure: str = ""
    reason: str = ""  # why it was skipped
    strict: bool = False  # a failure that is not run again
    processor: float = 0.0  # seconds of processor time; of tests in Python alone


def plain(name: str) -> str:
    """A test's name without the group that pytest-xdist appends."""
    return re.sub(r"@[^]]*$", "", name)


def slug(name: str) -> str:
    return re.sub(r"[^A-Za-z0-9.\[\]-]+", "-", name.replace("tests/", "")).strip("-")


def first_words(failure: str) -> str:
    """The failure in one line: pytest's first `E` line, else the last line with text."""
    lines = [line.strip() for line in failure.splitlines() if line.strip()]
    marked = [line[1:].strip() for line in lines if line.startswith("E ")]
    return (marked[:1] or lines[-1:] or ["?"])[0][:200]


def leave_make() -> None:
    """Remove from the environment what `make test T=words` puts there: an inner make, of a test or a build, would take
    it for words of its own."""
    for name in [*os.environ]:
        if name in WORDS_OF_MAKE or name.startswith("MAKE") or name in ("MFLAGS", "GNUMAKEFLAGS"):
            del os.environ[name]


class Suite:
    def __init__(self, long: bool = False, strict: bool = False) -> None:
        self.long, self.strict = long, strict
        self.tests: list[Test] = []
        self.begin = time.monotonic()
        self.lock = threading.Lock()  # of `tests` and their file: two parts may end at the same time
        self.parts: dict[str, float] = {}
        self.guests = 0
        TEST.mkdir(parents=True, exist_ok=True)
        RESULTS.write_text("")

    @contextlib.contextmanager
    def part(self, name: str) -> Iterator[None]:
        begin = time.monotonic()
        say(f"{name} ...")
        try:
            yield
        finally:
            self.parts[name] = self.parts.get(name, 0.0) + time.monotonic() - begin

    def _again(self, test: Test) -> bool:
        """Whether a failed test is run again."""
        return not self.strict and test.outcome == "failed" and not test.strict

    def fail(self, name: str, failure: str) -> None:
        """Add a failure of a part that is no test or did not report its tests."""
        self.take([Test(name, "failed", 0.0, failure)])

    def take(self, tests: Sequence[Test], again: Mapping[str, Test] | None = None) -> None:
        """Add outcomes; `again`: those of the second runs, by name."""
        for test in tests:
            test.failure = test.failure.encode("utf-8", "backslashreplace").decode()  # escapes lone surrogates
            if test.outcome == "failed":
                FAILED.mkdir(parents=True, exist_ok=True)
                (FAILED / f"{slug(test.name)}.txt").write_text(test.failure)
            if again and test.name in again and again[test.name].outcome == "passed":
                test.outcome = "flaky"
        with self.lock, RESULTS.open("a") as file:
            self.tests += tests
            file.writelines(json.dumps(dataclasses.asdict(test)) + "\n" for test in tests)

    def meson_named(self, only: str) -> None:
        """Run one C test, in each package of the desk build that has it."""
        root = OUTPUT / "desk/root"
        for package in native.packages():
            folder = OUTPUT / "desk" / package
            listed = output(["meson", "test", "--list", "-C", folder])  # fails where there are no tests
            if only in listed.splitlines():
                self.meson("desk", package, native.environment(root), only)

    def meson(self, name: str, package: str, environment: dict[str, str], *chosen: str, beside: bool = False) -> None:
        """Run the C tests of a package in output/<name>, or the chosen ones. `beside`: another part runs at the same
        time, so they get a lower priority, and their output is printed in one piece."""
        folder = OUTPUT / name / package

        def run(processes: int, *only: str) -> list[Test]:
            log = folder / "meson-logs/testlog.json"
            log.unlink(missing_ok=True)
            for old in folder.glob("sanitizer.*"):
                old.unlink()
            reports = {option: f"log_path={folder / 'sanitizer'}" for option in SANITIZERS}
            command = [*(BESIDE if beside else ()), "meson", "test", "--no-rebuild", "--print-errorlogs",
                       f"--num-processes={processes}", f"--timeout-multiplier={PATIENT}", "-C", str(folder), *only]
            done = subprocess.run(command, env={**os.environ, **environment, **reports}, stdin=subprocess.DEVNULL,
                                  text=True, errors="replace", stdout=subprocess.PIPE if beside else None,
                                  stderr=subprocess.STDOUT, check=False)
            if beside:
                say(done.stdout.rstrip())
            lines = log.read_text().splitlines() if log.exists() else []
            tests = [_of_meson(f"{name}: {package}: ", json.loads(line)) for line in lines]
            if found := [path.read_text(errors="replace") for path in sorted(folder.glob("sanitizer.*"))]:
                say("\n".join(found))
                tests.append(Test(f"{name}: {package}: sanitizer", "failed", 0.0, "\n".join(found), strict=True))
            if done.returncode and not any(test.outcome == "failed" for test in tests):
                self.fail(f"{name}: {package}: meson test", f"exit status {done.returncode}, see above")
            return tests

        tests = run(C_TESTS, *chosen)
        words = [test.name.rsplit(": ", 1)[-1] for test in tests if self._again(test)]
        self.take(tests, {test.name: test for test in run(1, *words)} if words else {})

    def pytest(self, words: Sequence[str], folders: Sequence[str], board: str = "") -> None:
        """Run tests in Python; `board`: with the image of that board."""
        def run(*arguments: str) -> list[Test]:
            results = TEST / "pytest.jsonl"
            results.write_text("")
            tier = f"--tier={'long' if self.long else 'gate'}"
            command = ["/usr/bin/python3", "-B", "-m", "pytest", tier, *arguments]
            env = {**os.environ, "BOARD": board, "EXTERNAL": trees.words(), "DDX_RESULTS": str(results)}
            before = f"{board}: " if board else ""
            what = f"{before}pytest {' '.join(arguments)}"
            how = ""
            try:
                status = subprocess.run(command, cwd=TOP, env=env, stdin=subprocess.DEVNULL, check=False,
                                        timeout=None if self.long else LIMIT).returncode
            except subprocess.TimeoutExpired:
                status, how = 1, f", stopped after {LIMIT} s"
            every = [json.loads(line) for line in results.read_text().splitlines()]
            lines = [line for line in every if "outcome" in line]
            done = {line["test"] for line in lines}
            hung = [line["begun"] for line in every if "begun" in line and line["begun"] not in done]
            if hung or how:
                self.fail(what, f"not finished: {', '.join(hung) or 'no test'}{how}")
            red = hung or how or any(line["outcome"] == "failed" for line in lines)
            if status not in (0, 5) and not (status == 1 and red):
                self.fail(what, f"exit status {status}, see above")
            for worker in {line["worker"] for line in lines}:
                self.guests += max(line["guests"] for line in lines if line["worker"] == worker)
            return [Test(before + line["test"], line["outcome"], line["seconds"], line["failure"], line["reason"],
                         line["strict"], line["processor"]) for line in lines]

        tests = run(*(["-k", " ".join(words)] if words else []), *folders)
        names = [test.name.removeprefix(f"{board}: ") for test in tests if self._again(test)]
        self.take(tests, {test.name: test for test in run(*names)} if names else {})

    def table(self) -> str:
        """Minutes of each part (parts overlap), the number of guests, the slowest tests, and those that take the most
        processor time, which is what a run of the gate waits for."""
        lines = ["", "minutes"]
        lines += [f"{seconds / 60:7.1f}  {name}" for name, seconds in self.parts.items()]
        took = time.monotonic() - self.begin
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        lines += [f"{took / 60:7.1f}  all, parts overlap; {self.guests} guests booted",
                  f"{(used.ru_utime + used.ru_stime) / 60:7.1f}  of processor time", "", "seconds"]
        slowest = sorted(self.tests, key=lambda test: test.seconds, reverse=True)[:SLOWEST]
        lines += [f"{test.seconds:7.1f}  {test.name}" for test in slowest]
        dearest = sorted(self.tests, key=lambda test: test.processor, reverse=True)[:SLOWEST]
        lines += ["", "seconds of processor time, of tests in Python"]
        lines += [f"{test.processor:7.1f}  {test.name}" for test in dearest if test.processor]
        return "\n".join(lines) + "\n"

    def verdict(self, flaky_file: pathlib.Path) -> int:
        """Print the failed and the skipped tests and the sums; returns 0 if all passed."""
        flaky = [test for test in self.tests if test.outcome == "flaky"]
        failed = [test for test in self.tests if test.outcome == "failed"]
        skipped = [test for test in self.tests if test.outcome == "skipped"]
        flaky_file.write_text("".join(f"FLAKY {test.name}\n{test.failure}\n\n" for test in flaky))
        for test in failed:
            say(f"FAILED {test.name}: {first_words(test.failure)}")
        for test in flaky:
            say(f"FLAKY {test.name}: {first_words(test.failure)}")
        for test in skipped:
            say(f"SKIPPED {test.name}: {test.reason}")
        passed = len(self.tests) - len(failed) - len(skipped)
        if not self.tests:
            say("no test has a name that matches")
        say(f"{passed} passed, {len(failed)} failed, {len(skipped)} skipped")
        return 1 if failed or not passed else 0


def _of_meson(prefix: str, line: dict[str, object]) -> Test:
    outcomes = {"OK": "passed", "EXPECTEDFAIL": "passed", "SKIP": "skipped"}
    said = "\n".join(str(line.get(name) or "") for name in ("stdout", "stderr"))
    duration = line.get("duration")
    seconds = float(duration) if isinstance(duration, (int, float)) else 0.0
    outcome = outcomes.get(str(line["result"]), "failed")
    return Test(prefix + str(line["name"]), outcome, seconds,
                failure=f"{line['result']}\n{said}" if outcome == "failed" else "",
                reason=first_words(said) if outcome == "skipped" else "",
                strict=outcome == "failed" and line.get("returncode") == FRAMES_BROKEN)
