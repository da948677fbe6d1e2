#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""A part of make bench: how late are the values of a replay? docs/logging.md.

bench_replay.py [-seconds N]: three items are written and logged, then replayed; a reader compares the clock with the
time at which each value was due. Writes output/bench/replay.json; fails if one in a hundred is a millisecond late.
"""
from __future__ import annotations

import argparse
import json
import os
import pathlib
import sys
import tempfile
import time

from bench_stream import Programs
from parts.bench.measure import percentile
from parts.common import OUTPUT, TOP, Failed, finish, say, wait_until
from parts.image import native

ITEMS = {"imu": 200, "wheels": 50, "gps": 10}  # values a second
LIMIT_US = 1000.0
STRUCT = "struct { long long number; double x[12]; }"


def wait_for(programs: Programs, item: str) -> None:
    import ddx  # pylint: disable=import-outside-toplevel

    def there() -> bool:
        try:
            with ddx.Store() as store, store.item(item):
                return True
        except ddx.Error:
            return False
    wait_until(there, f"{item} did not come: {programs.folder}", patience=10)


def record(programs: Programs, seconds: int) -> pathlib.Path:
    """The log of a robot."""
    import ddx  # pylint: disable=import-outside-toplevel
    (programs.folder / "log.conf").write_text("output log\nexcept *.stats\nitem *\n")
    logger = programs.start("ddxlog", "-c", "log.conf")
    wait_for(programs, "ddxlog.stats")
    with ddx.Store() as store:
        items = {name: store.create(name, "SENSOR", STRUCT) for name in ITEMS}
        begin, step = time.monotonic(), max(ITEMS.values())
        for number in range(step * seconds):
            time.sleep(max(0.0, begin + number / step - time.monotonic()))
            for name, rate in ITEMS.items():
                if number % (step // rate) == 0:
                    items[name].write({"number": number, "x": [float(number)] * 12})
        time.sleep(1)
    logger.terminate()
    logger.wait(20)
    return next((programs.folder / "log").glob("*.mcap"))


def replay(programs: Programs, log: pathlib.Path, seconds: int) -> list[float]:
    """How late each value of the fastest item was, in us."""
    import ddx  # pylint: disable=import-outside-toplevel
    late = []
    with ddx.Store() as store, store.item("again.imu", awaited=True) as item:
        item.keep(32)
        player = programs.start("ddxlog", "-replay", str(log), "-prefix", "again.")
        for _ in range(ITEMS["imu"] * seconds):
            with item.acquire(20, ddx.IN_ORDER) as frame:
                late.append((ddx.time_now() - frame.time) / 1000)
        missed = item.missed
        player.wait(20)
    if missed:
        raise Failed(f"the reader missed {missed} values")
    return late


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("-seconds", type=int, default=20)
    arguments = parser.parse_args()
    root = native.build()
    if "DDX_DIR" not in os.environ:  # again, with the library and a folder for the store
        with tempfile.TemporaryDirectory(prefix="ddx-") as folder:
            environment = {**os.environ, **native.environment(root), "DDX_DIR": folder,
                           "PYTHONPATH": str(TOP / "package/ddx/python")}
            return os.spawnve(os.P_WAIT, sys.executable, [sys.executable, *sys.argv], environment)
    programs = Programs(pathlib.Path(os.environ["DDX_DIR"]))
    try:
        late = replay(programs, record(programs, arguments.seconds), arguments.seconds)
    finally:
        programs.end()
    figures = {"values": len(late), "p50_us": round(percentile(late, 50), 1), "p99_us": round(percentile(late, 99), 1),
               "max_us": round(max(late), 1), "limit_p99_us": LIMIT_US}
    result = OUTPUT / "bench/replay.json"
    result.parent.mkdir(parents=True, exist_ok=True)
    result.write_text(json.dumps(figures, indent=1) + "\n")
    say(f"bench: replay: {figures['values']} values, late by p50 {figures['p50_us']} us, p99 {figures['p99_us']} us, "
        f"at most {figures['max_us']} us")
    return 0 if figures["p99_us"] < LIMIT_US else 1


if __name__ == "__main__":
    finish("bench", main)
