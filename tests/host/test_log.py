# SPDX-License-Identifier: GPL-2.0-or-later
"""The logger: every written value is in the file, or counted as lost."""
from __future__ import annotations

import json
import os
import pathlib
import signal
import subprocess
import time

import pytest

from lib import logs

from .log_rules import CONFIG, begin, check_log, check_sample, files, losses, only, write, written
from .programs import ROOT, Compiler, Desk, library_folder, lost, stop, wait_until

pytestmark = pytest.mark.strict


def test_every_value_of_every_item(desk: Desk, compile_client: Compiler) -> None:
    logger = begin(desk)
    writers = {"imu": write(desk, compile_client, "imu", 200, 15000),
               "gps": write(desk, compile_client, "gps", 20, 50000, "sample", 7_000_000),
               "ticks": write(desk, compile_client, "ticks", 50, 20000, "int", -3),
               "rows": write(desk, compile_client, "rows", 10, 20000, "extent")}
    expected = {name: written(desk, writer) for name, writer in writers.items()}
    status, counters = stop(logger)
    assert status == 0, desk.errors(logger)
    log = logs.read(only(desk))
    check_log(log, "imu", expected["imu"])
    check_log(log, "gps", expected["gps"])
    assert [one.value.value for one in log.values["ticks"]] == list(range(-3, 47))
    assert [one.value.end for one in log.values["rows"]] == list(range(1, 11))
    assert [bytes(one.value.row) for one in log.values["rows"]] == [bytes([n]) * 1000 for n in range(1, 11)]
    assert counters["in"] == counters["out"] == 280 and lost(counters) == 0 and counters["waiting"] == 0
    times = [one.log_time for topic in log.values.values() for one in topic]
    assert (log.statistics.message_start_time, log.statistics.message_end_time) == (min(times), max(times))
    offset = max(time.time_ns() - time.monotonic_ns() for _ in range(5))  # either call may be delayed
    assert abs(log.wall_offset - offset) < 50_000_000
    assert {chunk.compression for chunk in log.chunks} == {"lz4"}
    boot = pathlib.Path("/proc/sys/kernel/random/boot_id").read_text().strip()
    assert log.metadata["ddxlog"]["boot_id"] == boot


def test_counters_call_the_delay_until_on_disk(desk: Desk, compile_client: Compiler) -> None:
    """ddxlog flushes once a second, which would look like a fault if called latency."""
    logger = begin(desk)
    written(desk, write(desk, compile_client, "imu", 5, 1000))
    wait_until(lambda: desk.out("ddxlog") == 5)
    line, = desk.run("ddxctl", "stats").stdout.splitlines()
    assert line.startswith("ddxlog ") and ", until on disk us p50 " in line and "latency" not in line
    assert stop(logger)[1]["latency_until"] == "disk"


def test_the_check_of_logs_finds_each_change(desk: Desk, compile_client: Compiler) -> None:
    """A missing value, two swapped ones, a changed byte or a changed time each fail the check."""
    logger = begin(desk)
    expected = written(desk, write(desk, compile_client, "imu", 20, 20000))
    assert stop(logger)[0] == 0
    path = only(desk)
    check_log(logs.read(path), "imu", expected)

    def broken(number: int) -> logs.Log:
        log = logs.read(path)
        values = log.values["imu"]
        if number == 0:
            del values[7]
        elif number == 1:
            values[3], values[4] = values[4], values[3]
        elif number == 2:
            values[9].value.part[1].corner[0].x ^= 1
        else:
            values[5].publish_time += 1
        return log
    for number in range(4):
        with pytest.raises(AssertionError):
            check_log(broken(number), "imu", expected)
    data = bytearray(path.read_bytes())
    data[logs.read(path).chunks[0].chunk_start_offset + 200] ^= 1
    path.write_bytes(data)
    with pytest.raises(Exception):  # noqa: B017  of mcap
        logs.read(path)


def test_existing_values_are_logged(desk: Desk, compile_client: Compiler) -> None:
    """The newest value of an item without a writer is logged at the start, with the time of its write."""
    expected = written(desk, write(desk, compile_client, "settings", 3, 1000, readers=0))
    before = time.monotonic_ns()
    logger = begin(desk)
    wait_until(lambda: bool(desk.stats("ddxlog")["in"]))
    assert stop(logger)[1]["out"] == 1
    log = logs.read(only(desk))
    assert log.monotonic("settings") == [expected[-1][1]] and log.sequences("settings") == [3]
    assert log.values["settings"][0].log_time - log.wall_offset >= before


def test_patterns_exceptions_and_names(desk: Desk, compile_client: Compiler) -> None:
    logger = begin(desk, "output log\nexcept gps.raw\nitem gps*\nitem imu\n")
    names = ["gps", "gps.raw", "gps.fix", "imu", "imu2"]
    # Slower than the store makes room for the values that it keeps for the logger.
    writers = [write(desk, compile_client, name, 5, 20000, readers=0 if name in ("gps.raw", "imu2") else 1)
               for name in names]
    for writer in writers:
        written(desk, writer)
    assert stop(logger)[1]["out"] == 15
    assert set(logs.read(only(desk)).values) - {"ddxlog/lost"} == {"gps", "gps.fix", "imu"}


def test_a_stop_right_after_the_first_values(desk: Desk, compile_client: Compiler) -> None:
    """Values written before the logger's next look at the item are logged or counted."""
    for number in range(8):
        logger = begin(desk, f"output log{number}\nitem quick{number}\n", f"ddxlog{number}")
        written(desk, write(desk, compile_client, f"quick{number}", 5, 200))
        counters = stop(logger)[1]
        assert counters["in"] == 5 == counters["out"] + lost(counters)
        assert len(logs.read(only(desk, f"log{number}")).values[f"quick{number}"]) == counters["out"] > 0


def test_rate_limits_the_logged_values(desk: Desk, compile_client: Compiler) -> None:
    """The newest values, at most `rate` a second; the others are skipped, not lost."""
    logger = begin(desk, "output log\nitem fast rate=20\nitem slow rate=100\n")
    fast = write(desk, compile_client, "fast", 1000, 2000)
    slow = write(desk, compile_client, "slow", 10, 400_000)
    written(desk, fast)
    written(desk, slow)
    status, counters = stop(logger)
    log = logs.read(only(desk))
    assert len(log.values["fast"]) >= 20 and log.sequences("slow") == list(range(1, 11))
    stamps = log.monotonic("fast")
    assert (stamps[-1] - stamps[0]) / (len(stamps) - 1) >= 0.045e9
    assert lost(counters) == 0 and counters["in"] == counters["out"]
    assert counters["skipped"] + len(log.values["fast"]) >= log.sequences("fast")[-1]


def test_a_writer_that_comes_back(desk: Desk, compile_client: Compiler) -> None:
    logger = begin(desk)
    expected = written(desk, write(desk, compile_client, "imu", 30, 20000))
    time.sleep(1)
    expected += written(desk, write(desk, compile_client, "imu", 30, 20000, first=100))
    assert stop(logger)[0] == 0
    check_log(logs.read(only(desk)), "imu", expected)


def test_another_layout(desk: Desk, compile_client: Compiler) -> None:
    """The item's type changes, which is possible after some seconds without a writer; it gets a new channel."""
    logger = begin(desk)
    written(desk, write(desk, compile_client, "imu", 10, 2000))
    written(desk, write(desk, compile_client, "imu", 10, 20000, "other"))  # repeats until allowed
    status, counters = stop(logger)
    log = logs.read(only(desk))
    assert len([channel for channel in log.channels if channel.topic == "imu"]) == 2
    assert [one.value.number for one in log.values["imu"][:10]] == list(range(1, 11))
    others = [one.value.count for one in log.values["imu"][10:]]
    assert others == sorted(others) and others[-1] == 10 and counters["in"] == 20
    assert len(others) == 10 - counters["lost"]["store"] and counters["in"] == counters["out"] + lost(counters)


def test_losses_are_exact(desk: Desk, compile_client: Compiler) -> None:
    """The logger is frozen for a while: exactly the values that it counts as missed are not in the file."""
    logger = begin(desk)
    writer = write(desk, compile_client, "imu", 3000, 1000)
    wait_until(lambda: desk.sequence("imu") > 500)
    logger.send_signal(signal.SIGSTOP)
    before = desk.sequence("imu")
    wait_until(lambda: desk.sequence("imu") > before + 800)
    logger.send_signal(signal.SIGCONT)
    expected = written(desk, writer)
    status, counters = stop(logger)
    log = logs.read(only(desk))
    found = [one.value.number for one in log.values["imu"]]
    missing = sorted({number for number, _ in expected} - set(found))
    assert 100 < len(missing) < 2900 and found == sorted(set(found))
    assert counters["in"] == 3000 == counters["out"] + lost(counters)
    assert counters["lost"]["store"] == lost(counters) == len(missing) and counters["out"] == len(found)
    counted = losses(log, "imu")
    assert (counted["in"], counted["out"], counted["lost"]["store"]) == (3000, len(found), len(missing))
    times = dict(expected)
    assert log.monotonic("imu") == [times[number] for number in found]


SLOW = """
#define _GNU_SOURCE
#include <stdlib.h>
#include <unistd.h>
int fdatasync(int fd) { (void)fd; while (access(getenv("DDX_RELEASE"), F_OK)) usleep(10000); return 0; }
"""


def test_a_slow_disk_does_not_delay_the_store(desk: Desk, compile_client: Compiler) -> None:
    """A flush lasts until the writer has finished, and the queue is small: values are lost and counted there, none in
    the store."""
    release = desk.folder / "release"
    (desk.folder / "slow.c").write_text(SLOW)
    subprocess.run(["gcc", "-shared", "-fPIC", "slow.c", "-o", "slow.so"], cwd=desk.folder, check=True)
    logger = begin(desk, CONFIG + "queue 64K\n",
                   wrapper=("env", f"LD_PRELOAD={desk.folder}/slow.so", f"DDX_RELEASE={release}"))
    writer = write(desk, compile_client, "imu", 1500, 2000)
    expected = written(desk, writer)
    release.touch()
    status, counters = stop(logger)
    log = logs.read(only(desk))
    found = [one.value.number for one in log.values["imu"]]
    assert status == 0 and "the disk is too slow" in desk.errors(logger)
    assert counters["lost"]["queue"] > 100 and counters["in"] == 1500 == counters["out"] + lost(counters)
    assert len(found) == counters["out"] and losses(log, "imu")["lost"]["queue"] == counters["lost"]["queue"]
    # Values were read from the store as they came, also during a flush.
    assert counters["lost"]["store"] < 200
    times = dict(expected)
    assert log.monotonic("imu") == [times[number] for number in found]


def test_a_full_disk(desk: Desk, compile_client: Compiler) -> None:
    """Values in the file stay readable; the rest is counted."""
    logger = begin(desk, CONFIG, wrapper=("prlimit", "--fsize=60000"))
    writer = write(desk, compile_client, "noise", 2000, 1000, "noise")
    assert logger.wait(60) == 1
    writer.terminate()
    assert "logging stopped" in desk.errors(logger)
    assert logger.stdout
    counters = json.loads(logger.stdout.read().splitlines()[-1])
    assert counters["in"] == counters["out"] + lost(counters) and counters["lost"]["write"] > 0
    path = only(desk)
    assert desk.run("ddxlog", "-recover", path).returncode == 0
    assert len(logs.read(path).values.get("noise", [])) == counters["out"]


def test_segments(desk: Desk, compile_client: Compiler) -> None:
    """A new file each MiB: all values are in one of them, and each file describes all known channels."""
    written(desk, write(desk, compile_client, "settings", 1, 1000, readers=0))
    logger = begin(desk, "output log segment=1M\nexcept *.stats\nitem *\n")
    writer = write(desk, compile_client, "noise", 1000, 2000, "noise")
    expected = written(desk, writer)
    status, counters = stop(logger)
    found = [logs.read(path) for path in files(desk)]
    assert len(found) >= 3 and all(path.stat().st_size < 4 << 20 for path in files(desk))
    sequences = [sequence for log in found for sequence in log.sequences("noise")]
    # All except those that the store dropped when the logger was late; they are counted.
    assert status == 0 and set(sequences) <= set(range(1, len(expected) + 1))
    assert len(set(sequences)) == len(expected) - counters["lost"]["store"] and lost(counters) < 100
    assert len(sequences) <= len(expected) + len(found)
    assert all(log.sequences("settings") == [1] for log in found)


def test_the_newest_files_are_kept(desk: Desk, compile_client: Compiler) -> None:
    """Only files of this logger are deleted to make room."""
    folder = desk.folder / "log"
    folder.mkdir()
    old = [folder / f"ddxlog-{number:06}-20260101T000000Z.mcap" for number in (7, 8)]
    others = [folder / "ddxlog-000001-20260101T000000Z.txt", folder / "other-000001-20260101T000000Z.mcap",
              folder / "notes.mcap"]
    for path in [*old, *others]:
        path.write_bytes(bytes(1 << 20))
    logger = begin(desk, "output log segment=1M keep=5M\nexcept *.stats\nitem *\n")
    written(desk, write(desk, compile_client, "noise", 2000, 2000, "noise"))
    assert stop(logger)[0] == 0
    kept = [path for path in files(desk) if path not in others]
    made = desk.errors(logger).count("logging to ")
    deleted = desk.errors(logger).count("deleted to make room")
    assert made >= 4 and deleted == made + len(old) - len(kept) and not any(path.exists() for path in old)
    assert [int(path.name.split("-")[1]) for path in kept] == list(range(9 + made - len(kept), 9 + made))
    assert all(path.exists() for path in others)
    # A file ends after a chunk, whose size depends on the logger's delay.
    assert 1 << 20 < sum(path.stat().st_size for path in kept) < (5 << 20) + max(path.stat().st_size for path in kept)


@pytest.mark.parametrize("text,message", [
    ("", "logger.conf:1: no line says what to log: item NAME"),
    ("item\n", "logger.conf:1: item needs the name of an item"),
    ("# fine\nitem imu rate=fast\n", "logger.conf:2: rate=fast: a number above 0, up to 1000"),
    ("item imu rate=0\n", "logger.conf:1: rate=0: a number above 0"),
    ("item imu every=2\n", "logger.conf:1: every=2: after item PATTERN, rate=VALUES_A_SECOND is allowed"),
    ("except imu rate=2\nitem *\n", "logger.conf:1: rate=2: after except PATTERN, nothing more is allowed"),
    ("items imu\n", "logger.conf:1: items: a line begins with item, except, output or queue"),
    ("output\nitem *\n", "logger.conf:1: output needs a folder"),
    ("output a\noutput b\nitem *\n", "logger.conf:2: a second output"),
    ("output a segment=10\nitem *\n", "logger.conf:1: segment=10: a size from 1M to 4096M"),
    ("output a minutes=0\nitem *\n", "logger.conf:1: minutes=0: a whole number from 1 to 1440"),
    ("output a keep=1M\nitem *\n", "logger.conf:1: keep=1M: a size of 2M or more"),
    ("output a keep=500M\nitem *\n", "logger.conf:1: keep= needs room for two files"),
    ("output a size=3\nitem *\n", "logger.conf:1: size=3: after output FOLDER"),
    ("queue 1\nitem *\n", "logger.conf:1: queue needs a size from 64K to 1024M"),
    ("queue 1M 2M\nitem *\n", "logger.conf:1: queue needs"),
    ("item " + "n" * 64 + "\n", "logger.conf:1: nnnn"),
    ("item " + "n" * 2000 + "\n", "logger.conf:1: longer than"),
    ("item \x1b[31m\x07 rate=x\n", "logger.conf:1: rate=x"),
    ("\x1b]0;x\x07\n", "logger.conf:1: ?]0;x?: a line begins with"),
])
@pytest.mark.parametrize("check", [[], ["-check"]])
def test_wrong_configuration(tmp_path: pathlib.Path, text: str, message: str, check: list[str]) -> None:
    (tmp_path / "logger.conf").write_text(text)
    done = subprocess.run([ROOT / "bin/ddxlog", "-c", "logger.conf", *check], cwd=tmp_path, capture_output=True,
                          text=True, timeout=60, env={**os.environ, "DDX_DIR": "/nonexistent",
                                                      "LD_LIBRARY_PATH": str(library_folder())})
    assert done.returncode == 2 and done.stderr.count("\n") == 1 and "\x1b" not in done.stderr
    assert done.stderr.startswith("ddxlog: " + message), done.stderr


def test_good_configuration(tmp_path: pathlib.Path) -> None:
    (tmp_path / "logger.conf").write_text(
        "output /x segment=64M minutes=5 keep=1G # where\nqueue 8M\n\nitem a rate=0.5\nitem *\n")
    done = subprocess.run([ROOT / "bin/ddxlog", "-c", "logger.conf", "-check"], cwd=tmp_path, timeout=60,
                          env={**os.environ, "LD_LIBRARY_PATH": str(library_folder())})
    assert done.returncode == 0


def test_folder_that_cannot_be_written(desk: Desk) -> None:
    (desk.folder / "logger.conf").write_text("output /nonexistent/log\nitem *\n")
    done = desk.run("ddxlog", "-c", "logger.conf")
    assert done.returncode == 1 and "/nonexistent/log" in done.stderr and done.stderr.count("\n") == 1


def test_the_check_of_samples_finds_a_changed_value() -> None:
    """Proves that check_sample() can fail."""
    with pytest.raises(AttributeError):
        check_sample(object(), 1)
