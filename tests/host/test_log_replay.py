# SPDX-License-Identifier: GPL-2.0-or-later
"""A replayed log repeats the run: each value, in order, at its time; exported tables contain the same values."""
from __future__ import annotations

import csv
import json
import pathlib
import subprocess
import zlib

import pytest

from lib import logs

from .log_rules import begin, check_sample, only, write, written
from .programs import (ROOT, Compiler, Counters, Desk, lost, make_clip, pictures, read_y4m, start_recorder, stop, times,
                       wait_until)

pytestmark = pytest.mark.strict

Replayed = list[tuple[str, bytes, int]]  # item, bytes, ns since the first


def run_of(path: pathlib.Path, prefix: str = "") -> Replayed:
    """All logged values with their times, without the logger's own items and the clock."""
    log = logs.read(path)
    found = sorted((one.publish_time, topic, one.sequence, one.data) for topic, values in log.values.items()
                   for one in values if topic.startswith(prefix) and not topic.startswith(("ddxlog", "run.clock")))
    return [(topic.removeprefix(prefix), data, at - found[0][0]) for at, topic, _, data in found]


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory, compile_client: Compiler) -> pathlib.Path:
    """A log of four items over two seconds."""
    desk = Desk(tmp_path_factory.mktemp("first"))
    try:
        logger = begin(desk, "output first\nexcept *.stats\nitem *\n")
        writers = [write(desk, compile_client, "imu", 200, 10000),
                   write(desk, compile_client, "gps", 10, 200000, "other"),
                   write(desk, compile_client, "rows", 20, 90000, "extent"),
                   write(desk, compile_client, "n", 40, 40000, "int")]
        for writer in writers:
            written(desk, writer)
        status, counters = stop(logger)
        assert status == 0 and lost(counters) == 0 and counters["out"] == 270
        return only(desk, "first")
    finally:
        desk.end()


def replay(desk: Desk, path: pathlib.Path, *options: object, text: str | None = None) -> tuple[Counters, list[str]]:
    done = subprocess.run([ROOT / "bin/ddxlog", "-replay", path, *map(str, options)], env=desk.environment, text=True,
                          cwd=desk.folder, input=text, capture_output=True, timeout=60)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    return dict(json.loads(lines[-1])), lines[:-1]


def test_a_replay_repeats_the_run(desk: Desk, first: pathlib.Path) -> None:
    logger = begin(desk, "output second\nitem again.*\n")
    counters, _ = replay(desk, first, "-prefix", "again.", "-readers", "1")
    assert stop(logger)[0] == 0
    assert counters["in"] == counters["out"] == 270 and lost(counters) == 0
    assert run_of(only(desk, "second"), "again.") == run_of(first)  # times are equal to the nanosecond
    # No value is early, and half of them are on time, even on a busy machine.
    assert counters["last_ns"] - counters["first_ns"] > 1.7e9 and counters["latency_us"]["p50"] < 100_000
    # Types are equal, so a program that declares them can read the items.
    shown = json.loads(desk.run("ddxctl", "show", "again.imu", "--json").stdout)
    assert shown["value"]["number"] == 200 and shown["value"]["part"][2]["corner"][1]["x"] == 403
    assert json.loads(desk.run("ddxctl", "show", "again.rows", "--json").stdout)["value"]["end"] == 20


def test_the_comparison_finds_a_late_value(first: pathlib.Path) -> None:
    run = run_of(first)
    name, data, at = run[100]
    assert run != run[:100] + run[101:]
    assert run != run[:100] + [(name, data, at + 1)] + run[101:]
    assert run != run[:100] + [(name, bytes([data[0] ^ 1]) + data[1:], at)] + run[101:]


def test_a_part_is_replayed_at_another_rate(desk: Desk, first: pathlib.Path) -> None:
    whole = run_of(first)
    counters, _ = replay(desk, first, "-rate", "4", "-prefix", "fast.")
    assert counters["last_ns"] - counters["first_ns"] > 0.4e9 and counters["latency_us"]["p50"] < 100_000
    # Each limit lies between two values, whose times depend on the machine.
    logger = begin(desk, "output second\nitem part.*\n")
    start, end = ((whole[at - 1][2] + whole[at][2]) / 2e9 for at in (60, 150))
    counters, _ = replay(desk, first, "-rate", "0", "-from", f"{start:.9f}", "-to", f"{end:.9f}", "-prefix", "part.",
                         "-instance", "part", "-readers", "1")
    stop(logger)
    assert counters["out"] == 150 - 60


def test_replay_in_a_loop(desk: Desk, first: pathlib.Path) -> None:
    player = desk.start("ddxlog", "-replay", first, "-loop", "-rate", "0")
    wait_until(lambda: desk.out("ddxlog.replay") > 270 * 3)
    status, counters = stop(player)
    assert status == 0 and counters["in"] == counters["out"] + lost(counters)


def test_replay_in_steps(desk: Desk, first: pathlib.Path) -> None:
    """A value for each input line; or all values up to the next tick."""
    order = [topic for topic, _, _ in run_of(first)]
    counters, lines = replay(desk, first, "-step", "-prefix", "s.", text="\n" * 7)
    assert [line.split()[0] for line in lines] == order[:7] and counters["out"] == 7
    _, lines = replay(desk, first, "-tick", "gps", "-prefix", "t.", "-instance", "t", text="\n\n\n")
    found = [line.split() for line in lines]
    assert [words[1] for words in found if words[0] == "gps"] == ["1", "2", "3"] and found[-1][0] == "gps"
    assert [words[0] for words in found] == order[:len(found)]


def test_an_item_with_another_writer_is_left_out(desk: Desk, compile_client: Compiler, first: pathlib.Path) -> None:
    """The item is reported and counted; the other items are replayed."""
    other = write(desk, compile_client, "gps", 1000, 10000, "other", readers=0)
    wait_until(lambda: desk.sequence("gps") > 0)
    player = desk.run("ddxlog", "-replay", first, "-rate", "0")
    other.terminate()
    counters = json.loads(player.stdout.splitlines()[-1])
    assert player.stderr.count("gps: another program writes") == 1 and "-prefix" in player.stderr
    assert counters["lost"]["store"] == 10 and counters["in"] == 270 == counters["out"] + lost(counters)


def test_a_truncated_log_is_replayed(desk: Desk, first: pathlib.Path) -> None:
    (desk.folder / "cut.mcap").write_bytes(first.read_bytes()[:-100])
    counters, _ = replay(desk, desk.folder / "cut.mcap", "-rate", "0")
    assert counters["out"] == 270  # only the end record is missing


@pytest.mark.parametrize("options,message", [
    ([], "one of -c, -replay, -export and -recover"),
    (["-replay", "x", "-c", "y"], "one of -c, -replay"),
    (["-replay", "x", "-rate", "fast"], "-rate fast: a number"),
    (["-replay", "x", "-from", "soon"], "-from soon: seconds"),
    (["-replay", "x", "-from", "3", "-to", "2"], "-to 2: seconds"),
    (["-replay", "x", "-clock", "c", "-rate", "0"], "-clock c: needs time"),
    (["-replay", "x", "-readers", "-1"], "-readers -1: a number"),
    (["-export", "x"], "FILE is missing"),
    (["-replay", "x", "y"], "unexpected argument y"),
])
def test_bad_usage(desk: Desk, options: list[str], message: str) -> None:
    done = desk.run("ddxlog", *options)
    assert done.returncode == 2 and message in done.stderr and done.stderr.count("\n") == 1


# ---- Together with a recording ----

def start_of(recording: pathlib.Path) -> int:
    """XDDX_START: CLOCK_MONOTONIC of the first frame."""
    line = list(read_y4m(recording))[1][0]
    return int(next(word for word in line.split() if word.startswith("XDDX_START="))[11:])


def recorded_run(desk: Desk, log: pathlib.Path, video: pathlib.Path, prefix: str) -> Replayed:
    """Frames and values on one time axis, CLOCK_MONOTONIC."""
    found = logs.read(log)
    start = start_of(video)
    both = [(start + at, "video", data) for at, data in zip(times(video), pictures(video))]
    both += [(one.publish_time - found.wall_offset, topic.removeprefix(prefix), one.data)
             for topic, values in found.values.items() if topic.startswith(prefix + "imu") for one in values]
    both.sort()
    return [(name, data, at - both[0][0]) for at, name, data in both]


def test_log_and_recording_together(desk: Desk, compile_client: Compiler) -> None:
    """Frames and values are replayed by one clock and recorded again: every frame, value and time is equal. An MP4
    recording of the frames follows the same clock."""
    clip = make_clip(desk.folder / "clip.y4m", "64x48", "25", 50)
    logger = begin(desk, "output one\nitem imu\nitem video.parameters\n", "one")
    saver = start_recorder(desk, "-output", "one.y4m")
    coded = start_recorder(desk, "-output", "one.mp4", "-quality", "0", "-instance", "coded")
    writer = write(desk, compile_client, "imu", 250, 10000)
    wait_until(lambda: desk.sequence("imu") > 0)  # the log starts first
    assert desk.run("ddxvideoload", clip, "-readers", "2").returncode == 0
    written(desk, writer)
    assert stop(saver)[0] == stop(coded)[0] == 0
    code, logged = stop(logger)
    first = recorded_run(desk, only(desk, "one"), desk.folder / "one.y4m", "")
    # A logger that gets no processor for more than half a second misses values, and counts them.
    assert (code, len(first)) == (0, 300 - lost(logged))

    logger = begin(desk, "output two\nitem r.*\n", "two")
    saver = start_recorder(desk, "-output", "two.y4m", "-name", "again")
    other = start_recorder(desk, "-output", "three.y4m", "-name", "coded", "-instance", "coded")
    loader = desk.start("ddxvideoload", "one.y4m", "-name", "again", "-clock", "run.clock", "-readers", "1")
    decoder = desk.start("ddxvideoload", "one.mp4", "-name", "coded", "-clock", "run.clock", "-readers", "1",
                         "-instance", "decoder")
    # The replay waits only for its own readers; a loader has its readers before it looks for the clock.
    wait_until(lambda: desk.readers("again") == desk.readers("coded") == 1)
    counters, _ = replay(desk, only(desk, "one"), "-prefix", "r.", "-clock", "run.clock", "-readers", "1",
                         "-except", "*.stats,video*")
    assert loader.wait(60) == decoder.wait(60) == 0, desk.errors(loader) + desk.errors(decoder)
    assert stop(saver)[0] == stop(other)[0] == 0
    code, logged_again = stop(logger)
    second = recorded_run(desk, only(desk, "two"), desk.folder / "two.y4m", "r.")
    assert (code, len(second)) == (0, len(first) - lost(logged_again))
    assert second == [one for one in first if one in second]  # times are equal to the nanosecond
    third = desk.folder / "three.y4m"
    assert pictures(third) == pictures(desk.folder / "two.y4m") and times(third) == times(desk.folder / "two.y4m")
    assert start_of(third) == start_of(desk.folder / "two.y4m")
    assert counters["out"] == 250 - lost(logged)


def test_a_clock_needs_a_recording_that_knows_its_time(desk: Desk) -> None:
    clip = make_clip(desk.folder / "clip.y4m", "64x48", "25", 2)
    done = desk.run("ddxvideoload", clip, "-clock", "run.clock")
    assert done.returncode == 2 and "XDDX_START" in done.stderr


def test_a_clock_of_another_type_is_refused(desk: Desk) -> None:
    """The item of the program's own counters, which is larger than a clock."""
    clip = make_clip(desk.folder / "clip.y4m", "64x48", "25", 2)
    clip.write_bytes(clip.read_bytes().replace(b"FRAME\n", b"FRAME XTIME=0 XDDX_START=7000000000\n"))
    done = desk.run("ddxvideoload", clip, "-clock", "ddxvideoload.stats")
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].endswith("-clock ddxvideoload.stats: the item has another type, or one that "
                                                 "the program has not declared")


# ---- Tables ----

def test_tables(desk: Desk, first: pathlib.Path) -> None:
    assert desk.run("ddxlog", "-export", "tables", first).returncode == 0
    log = logs.read(first)
    folder = desk.folder / "tables"
    assert {one.name for one in folder.iterdir()} == {"imu.csv", "gps.csv", "rows.csv", "n.csv"}
    rows = list(csv.DictReader((folder / "imu.csv").open()))
    assert len(rows) == 200
    for row, one in zip(rows, log.values["imu"]):
        assert int(row["wall_ns"]) == one.publish_time and int(row["sequence"]) == one.sequence
        assert int(row["monotonic_ns"]) == one.publish_time - log.wall_offset
        number = int(row["number"])
        check_sample(one.value, number)
        assert row["text"] == f"n{number}" and float(row["part[2].wide"]) == number / 7 + 2
        assert int(row["part[1].corner[0].y"]) == -number - 1 and float(row["gearsLeft[3]"]) == number + 0.75
        assert float(row["ratio"]) == pytest.approx(number / 3, rel=1e-7)
    rows = list(csv.DictReader((folder / "rows.csv").open()))
    sums = [zlib.crc32(bytes([n]) * 1000) for n in range(1, 21)]
    assert [row["row"] for row in rows] == [f"1000 bytes crc32={one:08x}" for one in sums]
    assert [row["value"] for row in csv.DictReader((folder / "n.csv").open())] == [str(n) for n in range(1, 41)]
    again = desk.run("ddxlog", "-export", "tables", first)
    assert again.returncode == 1 and "name a new or an empty folder" in again.stderr
