#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""make test-long T=crash: kill and stop programs at random, 10,000 times, 500 with each seed; crash.py [EVENTS]

Finished runs are kept in output/crash/crash.jsonl and not repeated with the same programs.
"""
import functools
import json
import os
import pathlib
import subprocess
import sys
from collections.abc import Iterable
from typing import Any

from parts.common import OUTPUT, Failed, finish, say
from parts.image import native
from parts.testing.campaign import Campaign

RUN = 500
WORK = OUTPUT / "crash"
TESTS = OUTPUT / "desk/ddx/tests"

Run = dict[str, Any]


def text(runs: list[Run]) -> str:
    def total(name: str) -> int:
        return sum(run[name] for run in runs)

    def worst(name: str) -> float:
        return float(max(run[name] for run in runs))

    def mean(name: str, some: list[Run]) -> float:
        return float(sum(run[name] * run["takeovers"] for run in some) / max(1, sum(run["takeovers"] for run in some)))

    urgent = [run for run in runs if run["urgent"]]
    both = total("writers_and_stores")
    times = sorted(ms for run in runs for ms in run["takeover_ms"])
    p99 = times[len(times) * 99 // 100] if times else 0.0
    seeds = sorted(run["seed"] for run in runs)
    lines = [
        f"{total('kills')} kills, {RUN} with each of the seeds {seeds[0]} to {seeds[-1]}:",
        f"{total('writers')} of the writer, {total('standbys')} of a standby, {total('readers')} of a reader,",
        f"{total('workers')} of the store's worker, {total('stores')} of the whole store, {both} of writer and store",
        f"together; {total('stopped')} times a reader or the worker was stopped for a while instead, "
        f"{total('limited')} times",
        f"a program had no descriptor left, {total('crowds')} times a reader's socket was full.",
        f"{total('frames_written')} frames were written in {total('terms')} terms.",
        f"Three readers that lived all the time saw {total('seen')} and were told that they missed {total('missed')},",
        "each of these counts checked against what the writers wrote down.",
        f"Torn frames: {total('torn')}. Hangs: {total('hangs')}.",
        f"Takeovers: {total('takeovers')}, {mean('takeover_mean_ms', runs):.1f} ms on average, "
        f"{p99:.1f} ms p99, {worst('takeover_worst_ms'):.1f} ms at worst;",
        f"{total('takeovers_store_away')} more while the store was being restarted, "
        f"{worst('takeover_worst_ms_store_away'):.1f} ms at worst."]
    if urgent:
        published = [mean(f"{part}_mean_ms", urgent) for part in ("noticed", "granted", "published")]
        count, longest = sum(run["takeovers"] for run in urgent), max(run["published_worst_ms"] for run in urgent)
        lines += [
            f"With real-time priority ({count} of them) the first frame was published",
            f"after {sum(published):.1f} ms on average, {longest:.1f} ms at worst:",
            f"{published[0]:.1f} ms until the store noticed, {published[1]:.1f} until the next writer might write, "
            f"{published[2]:.1f} until it had."]
    return "\n".join(lines) + "\n"


def campaign(made_of: Iterable[pathlib.Path]) -> Campaign:
    return Campaign(WORK / "crash.jsonl", made_of, kills_of_a_run=RUN)


def one_run(seed: int) -> Run:
    say(f"crash: {(seed - 1) * RUN} kills ...")
    done = subprocess.run([TESTS / "test-crash", "random", str(RUN), str(seed)], capture_output=True, text=True,
                          timeout=1800, check=False,
                          env={**os.environ, "DDX_STORE_PROGRAM": str(TESTS / "store-with-faults"),
                               "DDX_CRASH_URGENT": "1"})
    if done.returncode:
        errors = [line for line in done.stderr.splitlines() if not line.startswith("ddxstore:")]
        raise Failed("\n".join([f"seed {seed} failed:", *errors]))
    found: Run = json.loads(next(line for line in done.stdout.splitlines() if '"kills"' in line))
    return found


def main() -> int:
    kills = int(sys.argv[1]) if len(sys.argv) > 1 else 10000
    native.build()
    steps = campaign([TESTS / "test-crash", TESTS / "store-with-faults"])
    runs = [steps.once(f"seed {seed}", functools.partial(one_run, seed))
            for seed in range(1, (kills + RUN - 1) // RUN + 1)]
    say(f"{text(runs)}crash: {len(runs) * RUN} kills, no torn frame, no hang")
    return 0


if __name__ == "__main__":
    finish("crash", main)
