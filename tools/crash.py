#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""make crash: 10,000 times something goes wrong, at random, in runs of 500 with a seed each; crash.py [EVENTS]

Can be interrupted: runs that are done are kept in output/crash.json and not repeated, until the programs change.
"""
import hashlib
import json
import os
import subprocess
import sys
from typing import Any

from parts.common import OUTPUT, TOP, Failed, say
from parts.image import native

RUN = 500
RESULTS = OUTPUT / "crash.json"
PAGE = TOP / "docs/crash.md"
BEGIN, END = "<!-- make crash writes this -->\n", "<!-- end -->\n"

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


def main() -> int:
    kills = int(sys.argv[1]) if len(sys.argv) > 1 else 10000
    try:
        native.build()
    except Failed as error:
        say(f"crash: {error}")
        return 1
    tests = OUTPUT / "desk/ddx/tests"
    program, store = tests / "test-crash", tests / "store-with-faults"
    key = hashlib.sha256(program.read_bytes() + store.read_bytes()).hexdigest()
    kept = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
    runs: list[Run] = kept["runs"] if kept.get("programs") == key else []
    for seed in range(len(runs) + 1, (kills + RUN - 1) // RUN + 1):
        say(f"crash: {len(runs) * RUN} of {kills} kills ...")
        done = subprocess.run([program, "random", str(RUN), str(seed)], capture_output=True, text=True, timeout=1800,
                              check=False, env={**os.environ, "DDX_STORE_PROGRAM": str(store), "DDX_CRASH_URGENT": "1"})
        if done.returncode:
            errors = [line for line in done.stderr.splitlines() if not line.startswith("store:")]
            say("\n".join([f"crash: seed {seed} failed:", *errors]))
            return 1
        runs.append(json.loads(next(line for line in done.stdout.splitlines() if '"kills"' in line)))
        RESULTS.write_text(json.dumps({"programs": key, "runs": runs}))
    page = PAGE.read_text()
    head, tail = page.split(BEGIN)[0], page.split(END)[1]
    PAGE.write_text(head + BEGIN + text(runs) + END + tail)
    say(f"crash: {len(runs) * RUN} kills, nothing torn, nobody stuck; docs/crash.md")
    return 0


if __name__ == "__main__":
    sys.exit(main())
