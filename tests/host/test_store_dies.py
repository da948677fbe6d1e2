# SPDX-License-Identifier: GPL-2.0-or-later
"""Store, writers and readers are killed, at random and at each point of the protocol: no torn frame, no hang."""
from __future__ import annotations

import json
import os
import subprocess
from typing import Any

import pytest

from lib.figures import Figure
from parts.common import MORTAL, OUTPUT

pytestmark = pytest.mark.retry

TESTS = OUTPUT / "desk/ddx/tests"
SEEDS = 10  # per test; 200 in all


def run(*arguments: str) -> str:
    """
    Run test-crash and return its last line, counts as JSON. Not in parallel: with three at once, the kernel was busy
    with dead processes in /proc, and everything stalled for seconds.
    """
    done = subprocess.run([*MORTAL, TESTS / "test-crash", *arguments], text=True, capture_output=True, check=False,
                          timeout=1800, env={**os.environ, "DDX_STORE_PROGRAM": str(TESTS / "store-with-faults")})
    said = "\n".join(line for line in done.stderr.splitlines() if not line.startswith("ddxstore:"))
    assert done.returncode == 0, f"test-crash {' '.join(arguments)}: {said}"
    return next((line for line in done.stdout.splitlines() if line.startswith('{"kills"')), "")


@pytest.mark.long
@pytest.mark.parametrize("first", range(3001, 3201, SEEDS))
def test_killed_at_random(first: int, record_property: Figure) -> None:
    runs: list[dict[str, Any]] = [json.loads(run("random", "300", str(seed))) for seed in range(first, first + SEEDS)]
    for name in ("kills", "frames_written", "torn", "hangs"):
        record_property(name, sum(one[name] for one in runs))
    record_property("takeover_worst_ms", max(one["takeover_worst_ms"] for one in runs))
    assert all(one["kills"] >= 300 for one in runs)


@pytest.mark.long
@pytest.mark.parametrize("first", range(1, 51, 10))
def test_killed_and_stopped_at_each_point(first: int, record_property: Figure) -> None:
    """Fifty runs in all."""
    for _ in range(10):
        run("walk")
    record_property("walks", first + 9)
