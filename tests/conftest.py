# SPDX-License-Identifier: GPL-2.0-or-later
"""For all tests: two tiers, and the results that each run writes for its summary.

Tests marked `long` take minutes of video or many repetitions; `make test-long` runs them, `make test` the others. The
outcome of each test is written to $DDX_RESULTS (JSON lines), a long one's also to output/long/<board>.jsonl, with its
figures (pytest's record_property). A long test that passed with this image and these programs is not run again.

Each test is marked `strict` or `retry`, itself or its module. An assertion that fails in a strict test gets no second
chance: tests that judge frames, values and counters are strict.

A test that hangs fails after `--limit` seconds, with a list of all processes.
"""
import functools
import json
import os
import pathlib
import shutil
import signal
import time
from collections.abc import Iterator

import pytest

from parts import processes
from parts.common import OUTPUT
from parts.guest import machine, qemu
from parts.testing import suite
from parts.testing.campaign import Campaign

LONG = OUTPUT / "long"
SECONDS = 600
LIMIT = 600    # s; 20 times what a test of the gate may take
AGAIN = 60     # s; a fixture may hang, too, when a failed test is cleaned up
USUAL = os.getpriority(os.PRIO_PROCESS, 0)
LATER = USUAL + 10  # of tests that wait for no frame


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--tier", choices=("gate", "long", "all"), default="all", help="which tests: short or long ones")
    parser.addoption("--seconds", type=int, default=SECONDS, help="of video in tests that last; fewer are no proof")
    parser.addoption("--limit", type=int, default=LIMIT, help="of a test that is not long, in seconds")


@functools.cache
def long_results() -> Campaign:
    """Outcomes of the long tests of one image."""
    board = os.environ.get("BOARD") or machine.DEV
    return Campaign(LONG / f"{board}.jsonl", [OUTPUT / board / "disk.img", OUTPUT / "desk/root"])


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    tier = config.getoption("tier")
    unmarked = {str(item.path) for item in items
                if not item.get_closest_marker("strict") and not item.get_closest_marker("retry")}
    if unmarked:
        raise pytest.UsageError(f"neither strict nor retry (see pytest.ini): {', '.join(sorted(unmarked))}")
    dropped = []
    for item in items:
        is_long = item.get_closest_marker("long") is not None
        if tier == "gate" and is_long or tier == "long" and not is_long:
            dropped.append(item)
        elif tier == "long" and long_results().results.get(suite.plain(item.nodeid), {}).get("outcome") == "passed":
            dropped.append(item)
    config.hook.pytest_deselected(items=dropped)
    items[:] = [item for item in items if item not in dropped]


def why(report: pytest.TestReport) -> str:
    """Of a test that was skipped, or that is known to fail."""
    if isinstance(report.longrepr, tuple):
        return report.longrepr[2].removeprefix("Skipped: ")
    return str(getattr(report, "wasxfail", "")).removeprefix("reason: ")


def write(line: dict[str, object]) -> None:
    if where := os.environ.get("DDX_RESULTS"):
        with open(where, "a") as file:
            file.write(json.dumps(line) + "\n")


class Outcomes:
    """The outcome of each test: its three phases together."""

    def __init__(self) -> None:
        self.items: dict[str, pytest.Item] = {}
        self.seconds: dict[str, float] = {}
        self.processor: dict[str, float] = {}
        self.failures: dict[str, str] = {}
        self.skipped: dict[str, str] = {}
        self.strict: set[str] = set()

    def add(self, item: pytest.Item, report: pytest.TestReport, error: BaseException | None) -> None:
        self.items[report.nodeid] = item
        self.seconds[report.nodeid] = self.seconds.get(report.nodeid, 0.0) + report.duration
        if report.failed:
            said = "".join(f"\n{title}\n{text}" for title, text in report.sections)
            self.failures.setdefault(report.nodeid, report.longreprtext + said)
            if isinstance(error, AssertionError) and item.get_closest_marker("strict"):
                self.strict.add(report.nodeid)
        if report.skipped:
            self.skipped[report.nodeid] = why(report)

    def end(self, item: pytest.Item) -> None:
        name = item.nodeid
        outcome = "failed" if name in self.failures else "skipped" if name in self.skipped else "passed"
        line = {"test": suite.plain(name), "outcome": outcome, "seconds": round(self.seconds.get(name, 0.0), 2),
                "processor": round(self.processor.get(name, 0.0), 2),
                "guests": qemu.Guest.started, "worker": os.environ.get("PYTEST_XDIST_WORKER", "")}
        write({**line, "strict": name in self.strict, "failure": self.failures.get(name, ""),
               "reason": self.skipped.get(name, "") if outcome == "skipped" else ""})
        proof = int(item.config.getoption("seconds")) >= SECONDS
        if item.get_closest_marker("long") and outcome != "skipped" and proof:
            when = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
            long_results().add(suite.plain(name), {**line, "when": when, "figures": dict(item.user_properties)})


OUTCOMES = Outcomes()


def processor_seconds() -> float:
    """Of this process, of those that it waited for, and of the guests, which run on between tests."""
    return sum(os.times()[:4]) + sum(processes.seconds(guest.process.pid) for guest in qemu.Guest.alive)


@pytest.fixture
def tmp_path(tmp_path: pathlib.Path, request: pytest.FixtureRequest) -> Iterator[pathlib.Path]:
    """Clips, recordings and disks are large: only files of a failing test are kept."""
    yield tmp_path
    if request.node.nodeid not in OUTCOMES.failures:
        shutil.rmtree(tmp_path, ignore_errors=True)


@pytest.fixture(scope="session", autouse=True)
def no_leftovers(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """The same for what several tests share."""
    yield
    if not OUTCOMES.failures:
        shutil.rmtree(tmp_path_factory.getbasetemp(), ignore_errors=True)


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[None]):  # type: ignore[no-untyped-def]
    result = yield
    OUTCOMES.add(item, result.get_result(), call.excinfo.value if call.excinfo else None)


@pytest.hookimpl(optionalhook=True)
def pytest_handlecrashitem(crashitem: str, report: pytest.TestReport) -> None:
    """A test during which its process died, so that only pytest-xdist can report it."""
    write({"test": suite.plain(crashitem), "outcome": "failed", "seconds": 0.0, "processor": 0.0, "guests": 0,
           "worker": "", "strict": False, "failure": str(report.longrepr), "reason": ""})


def hangs(*_: object) -> None:
    pytest.fail(f"the test hangs; all processes:\n{processes.listing()}")


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_protocol(item: pytest.Item):  # type: ignore[no-untyped-def]
    if os.geteuid() == 0:  # no other user gets a priority back
        os.setpriority(os.PRIO_PROCESS, 0, LATER if item.get_closest_marker("computes") else USUAL)
    write({"begun": suite.plain(item.nodeid)})
    if not item.get_closest_marker("long"):
        signal.signal(signal.SIGALRM, hangs)
        signal.setitimer(signal.ITIMER_REAL, item.config.getoption("limit"), AGAIN)
    begin = processor_seconds()
    yield
    signal.setitimer(signal.ITIMER_REAL, 0)
    OUTCOMES.processor[item.nodeid] = processor_seconds() - begin
    OUTCOMES.end(item)
