# SPDX-License-Identifier: GPL-2.0-or-later
"""The benchmark's measuring: injected faults and delays must show. Other times of this machine are not judged."""
from __future__ import annotations

import dataclasses
import os
import pathlib
import re
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest

from bench import loss, plot, store as bench
from bench.loss_chromium import Chromium
from bench.loss_figures import with_inferred
from bench.loss_peers import OURS
from bench.loss_run import Case as LossCase
from bench.measure import Case, Slice, Store, cpus, percentile, run_slice
from parts.common import MORTAL, TOP

pytestmark = pytest.mark.retry

Run = Callable[..., Slice]
CASE = Case("cif-1x2-zerocopy", 152064, 2, "zerocopy", 15000, 40, ("ddx", "futex"))  # slowly: the machine may be busy


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Run]:
    bench.build(peers=False)
    folder = tmp_path_factory.mktemp("bench")
    store = Store(folder)
    yield lambda peer, mode="zerocopy", frames=CASE.frames, **faults: run_slice(
        dataclasses.replace(CASE, mode=mode, frames=frames), peer, folder, store, **faults)
    store.end()


@pytest.mark.strict
@pytest.mark.parametrize("peer, mode", [("futex", "zerocopy"), ("futex", "copy"), ("ddx", "zerocopy"), ("ddx", "copy"),
                                        ("ddx", "direct")])
def test_frames_arrive_whole(measured: Run, peer: str, mode: str) -> None:
    found = measured(peer, mode)
    assert found.torn == 0 or peer == "futex"  # its writer may overwrite a frame that is being read
    assert len(found.latency) + found.lost == CASE.frames * CASE.readers
    assert len(found.latency) > CASE.readers  # a reader may miss some on a busy machine
    assert found.p50 > 0 and found.writer_cpu > 0 and found.reader_cpu > 0


@pytest.mark.strict
@pytest.mark.parametrize("peer", ["futex", "ddx"])
def test_a_frame_that_is_not_sent_is_lost(measured: Run, peer: str) -> None:
    for number in (20, 50):  # one in the middle, and the last one
        found = measured(peer, skip=number)
        assert found.lost >= CASE.readers
        assert len(found.latency) + found.lost == CASE.frames * CASE.readers


@pytest.mark.strict
@pytest.mark.parametrize("mode", ["zerocopy", "copy", "direct"])
def test_a_torn_frame_is_counted(measured: Run, mode: str) -> None:
    for _ in range(10):
        found = measured("ddx", mode, tear=20)
        assert found.lost >= found.torn
        if found.torn:
            break  # otherwise both readers missed this frame on a busy machine
    assert 1 <= found.torn <= CASE.readers


def test_a_delay_shows_in_the_latency(measured: Run) -> None:
    late = measured("futex", late=3000)
    assert min(late.latency) >= 3000
    assert min(measured("futex").latency) < 3000


def test_a_busy_core_is_reported(measured: Run) -> None:
    """Losses on a busy core are no program's fault, so the load must be reported. Niceness is inherited.

    The programs yield, but not with niceness 19: beside other tests, no reader would see two frames in a second.
    """
    yielding = ThreadPoolExecutor(1, initializer=lambda: os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), 15))
    hogs = [subprocess.Popen([*MORTAL, "taskset", "-c", str(core), sys.executable, "-c", "while True: pass"])
            for core in cpus()]
    try:
        shared = yielding.submit(measured, "futex", frames=120).result().queued
    finally:
        for hog in hogs:
            hog.kill()
            hog.wait()
        yielding.shutdown()
    assert shared > 20


def test_percentiles() -> None:
    assert percentile(range(1, 101), 50) == 50
    assert percentile(range(1, 101), 99) == 99
    assert percentile([7.0], 99) == 7


def test_report_and_picture(measured: Run, tmp_path: pathlib.Path) -> None:
    slices = {(CASE.name, peer): [measured(peer)] for peer in CASE.peers}
    result: dict[str, Any] = {"machine": bench.machine(), "rounds": 1, **bench.report([CASE], slices)}
    assert [one["peer"] for one in result["cases"]] == ["ddx", "futex"]
    assert result["cases"][1]["ddx_ratio"]["p50"] > 0
    page = plot.page(result)
    assert page.count("<rect") == 6 and "src=" not in page and "href=" not in page


@pytest.mark.parametrize("words", [("store", "-rounds", "1", "-cases", "cif-1x1-zero,direct"), ("stream",), ("replay",),
                                   ("loss",), ("stereo",), ("view",), ("catalog",),
                                   pytest.param(("mp4",), marks=pytest.mark.long)],
                         ids=lambda words: str(words[0]))
def test_each_benchmark_runs(words: tuple[str, ...]) -> None:
    """A short `make bench`: options and output still fit the programs. Figures are not judged."""
    done = subprocess.run([*MORTAL, TOP / "tools/bench", *words, "-short"], timeout=120,
                          stdin=subprocess.DEVNULL, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    found = {"store": r"cif-1x1-zerocopy +ddx ", "stream": r"h264 (.|\n)*mpeg4 (.|\n)*SRTP \d",
             "replay": r"replay: [1-9]\d* values", "loss": r"clean, short, .* shown [1-9]",
             "stereo": r"368x248, 48 disparities, SGBM: ",
             "view": r"forward .*\n.*back .*\n.* start (.|\n)*frame: [1-9]",
             "mp4": r"cif: \d.* times x264 alone; \d[\d.]* MB/s",
             "catalog": r"first .*\nmirror .* ratio \d.*\nclock .*\d"}[words[0]]
    assert re.search(found, done.stdout), done.stdout


def test_a_peer_that_is_not_installed_is_reported_and_left_out(monkeypatch: pytest.MonkeyPatch,
                                                  capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(Chromium, "program", "no-such-browser")
    cases = [LossCase(name, "iid 30", "real") for name in (OURS, Chromium.name)]
    assert loss.available(cases) == cases[:1]
    assert capsys.readouterr().out.count("no-such-browser is not installed") == 1


def test_unreadable_numbers_are_inferred_from_their_neighbours() -> None:
    """Only if as many pictures as numbers are missing; otherwise none of them gets a number."""
    assert with_inferred([5, None, None, 8, None, 11, None, 12, None]) == [5, 6, 7, 8, None, 11, None, 12, None]
    assert with_inferred([None, 1, 2]) == [None, 1, 2]
    assert with_inferred([215, 215, 215, 218]) == [215, 216, 217, 218]  # one picture too coarse to show its number
    assert with_inferred([5, 5, 6]) == [5, 5, 6]  # shown twice
    assert with_inferred([9, None, 3, 4]) == [9, None, 3, 4]  # a number changed by damage
