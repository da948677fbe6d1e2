# SPDX-License-Identifier: GPL-2.0-or-later
"""make bench: how late are the values of a replay? See docs/logging.md.

tools/bench replay [-seconds N] [-short]: three items are written and logged, then replayed; a reader compares the clock
with the time at which each value was due. Writes output/bench/replay.json; fails if a value is not in the log, or one
in a hundred is a millisecond late. -short: half a second, for the gate; writes no file and judges nothing.
"""
import json
import os
import pathlib
import sys
import time

from bench.measure import percentile, save
from bench.programs import Programs
from parts.common import TOP, Failed, command_line, finish, run, say, scratch, wait_until
from parts.image import native

ITEMS = {"imu": 200, "wheels": 50, "gps": 10}  # values a second
LIMIT_US = 1000.0
SHORT = 0.5  # s
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


def written(rate: int, seconds: float) -> int:
    """Number of values written to an item."""
    step = max(ITEMS.values())
    return len(range(0, int(step * seconds), step // rate))


def logger_reads(programs: Programs) -> bool:
    listed = json.loads(run([programs.bin / "ddxctl", "list", "-json"], env=programs.environment))["items"]
    return sum(int(one["readers"]) for one in listed if one["name"] in ITEMS) == len(ITEMS)


def record(programs: Programs, seconds: float) -> pathlib.Path:
    """Write a log. Waits for the logger, which finds an item up to 50 ms late and does not log earlier values."""
    import ddx  # pylint: disable=import-outside-toplevel
    (programs.folder / "log.conf").write_text("output log\n" + "".join(f"item {name}\n" for name in ITEMS))
    logger = programs.start("ddxlog", "-c", "log.conf")
    wait_for(programs, "ddxlog.stats")
    with ddx.Store() as store:
        items = {name: store.create(name, "SENSOR", STRUCT) for name in ITEMS}
        wait_until(lambda: logger_reads(programs), "the logger does not find the items", patience=30)
        begin, step = time.monotonic(), max(ITEMS.values())
        for number in range(int(step * seconds)):
            time.sleep(max(0.0, begin + number / step - time.monotonic()))
            for name, rate in ITEMS.items():
                if number % (step // rate) == 0:
                    items[name].write({"number": number, "x": [float(number)] * 12})
        every = sum(written(rate, seconds) for rate in ITEMS.values())
        wait_until(lambda: programs.count("ddxlog", "in") >= every, "the logger does not read all values", patience=30)
    logger.terminate()
    logger.wait(20)
    return next((programs.folder / "log").glob("*.mcap"))


def replay(programs: Programs, log: pathlib.Path) -> list[float]:
    """Delay of each value of the fastest item, in us."""
    import ddx  # pylint: disable=import-outside-toplevel
    late, ended = [], False
    with ddx.Store() as store, store.item("again.imu", awaited=True) as item:
        item.keep(128)
        player = programs.start("ddxlog", "-replay", str(log), "-prefix", "again.")
        while not ended:
            ended = player.poll() is not None
            try:
                while True:
                    with item.acquire(0.2, ddx.IN_ORDER) as frame:
                        late.append((ddx.time_now() - frame.time) / 1000)
            except TimeoutError:
                pass
        missed = item.missed
    if missed:
        raise Failed(f"the reader missed {missed} values")
    return late


def main() -> int:
    arguments = command_line(__doc__, seconds=20.0, short=False)
    if "DDX_DIR" not in os.environ:  # start again with the library and a folder for the store
        root = native.build()
        with scratch() as folder:
            environment = {**os.environ, **native.environment(root), "DDX_DIR": str(folder),
                           "PYTHONPATH": f"{TOP}/package/ddx/python:{TOP}/tools:{TOP}"}
            return os.spawnve(os.P_WAIT, sys.executable, sys.orig_argv, environment)
    seconds = SHORT if arguments.short else arguments.seconds
    with Programs(pathlib.Path(os.environ["DDX_DIR"])) as programs:
        late = replay(programs, record(programs, seconds))
    lost = written(ITEMS["imu"], seconds) - len(late)
    if not late:
        raise Failed("no value came")
    figures = {"values": len(late), "lost": lost, "p50_us": round(percentile(late, 50), 1),
               "p99_us": round(percentile(late, 99), 1), "max_us": round(max(late), 1), "limit_p99_us": LIMIT_US}
    say(f"bench: replay: {figures['values']} values, {lost} not in the log, late by p50 {figures['p50_us']} us, "
        f"p99 {figures['p99_us']} us, at most {figures['max_us']} us")
    if arguments.short:
        return 0
    save("replay", figures)
    return 0 if figures["p99_us"] < LIMIT_US and not lost else 1


if __name__ == "__main__":
    finish("bench", main)
