# SPDX-License-Identifier: GPL-2.0-or-later
"""Two cameras as a stereo pair: frames of the same time are paired, and all others are counted."""
from __future__ import annotations

import json
import random
import subprocess
from collections.abc import Iterator

import pytest

from lib.calibration import ideal
from parts.common import MORTAL

from .programs import (TOP, Counters, Desk, Process, pictures, start_recorder, stop, times, wait_for_recorder,
                       wait_until)
from .stereo_rules import SVS, check_sum, settled, start, write_calibration

pytestmark = pytest.mark.strict

WIDTH, HEIGHT = 64, 16
LEFT = f"{WIDTH}x{HEIGHT}"
PERIOD, WINDOW = 40, 20  # ms


class Cameras:
    """Both cameras, which send frames on request, and the program that pairs them."""

    def __init__(self, desk: Desk, right: str, *options: object) -> None:
        self.desk = desk
        self.writer = subprocess.Popen([*MORTAL, "/usr/bin/python3", "-B", TOP / "tests/host/eyes_client.py", LEFT,
                                        right], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
                                       env={**desk.environment, "PYTHONPATH": str(TOP / "package/ddx/python")})
        self.expect("ready")
        file = write_calibration(desk.folder / "stereo.yml", ideal(WIDTH, HEIGHT))
        self.process: Process = start(desk, file, "-left", "left", "-right", "right", "-disparities", 16,
                                      *options)
        wait_until(lambda: desk.readers("left") == desk.readers("right") == 1)
        self.written = 0

    def expect(self, word: str) -> None:
        assert self.writer.stdout
        assert self.writer.stdout.readline() == f"{word}\n"

    def _write(self, *lines: str) -> None:
        """Write frames, and wait until the program has taken them."""
        assert self.writer.stdin
        self.writer.stdin.write("".join(f"{line}\n" for line in lines))
        self.writer.stdin.flush()
        for _ in lines:
            self.expect("written")
        self.written += len(lines)
        wait_until(lambda: int(self.desk.stats(SVS)["in"]) >= self.written)

    def write(self, name: str, milliseconds: int, value: int) -> None:
        self._write(f"{name} {milliseconds} {value}")

    def end(self) -> None:
        assert self.writer.stdin and self.writer.stdout
        self.writer.stdin.close()
        self.writer.wait(10)
        self.writer.stdout.close()

    def write_pair(self, milliseconds: int, value: int) -> None:
        """Both at once: a frame waits for its partner for 0.28 s only."""
        self._write(*(f"{name} {milliseconds} {value}" for name in ("left", "right")))

    def write_pairs(self, number: int, pairs: int) -> int:
        """Write pairs from this number on until `pairs` in a row came out: a machine may be so busy that the second
        frame comes too late. Returns the number of the last pair."""
        came, last = 0, number + 100
        while True:
            out = self.settled()["out"]
            self.write_pair(number * PERIOD, number)
            came = came + 1 if self.settled()["out"] == out + 2 else 0
            if came == pairs:
                return number
            number += 1
            assert number < last, self.settled()

    def settled(self) -> Counters:
        return settled(self.desk, self.written)

    def said(self) -> str:
        return self.desk.errors(self.process)


@pytest.fixture
def cameras(desk: Desk, request: pytest.FixtureRequest) -> Iterator[Cameras]:
    cameras = Cameras(desk, getattr(request, "param", LEFT))
    yield cameras
    cameras.end()


def test_frames_of_shuffled_times(cameras: Cameras) -> None:
    """Values identify the capture times: the frames of each pair belong together, and all others are counted."""
    desk, chance = cameras.desk, random.Random(5)
    saver = start_recorder(desk, "-name", "range", "-output", "range.y4m")
    wait_for_recorder(desk)
    cameras.write_pair(PERIOD, 1)
    cameras.settled()
    order = [(eye, number) for number in range(2, 14) for eye in ("left", "right")]
    for first in range(0, len(order), 8):
        part = order[first:first + 8]
        chance.shuffle(part)
        order[first:first + 8] = part
    early = {("right", number): chance.randrange(-WINDOW + 1, WINDOW) for number in range(2, 14)}
    for eye, number in order:
        cameras.write(eye, number * PERIOD + early.get((eye, number), 0), number)
    last = cameras.write_pairs(14, 3)
    status, counters = stop(cameras.process)
    assert status == 0
    check_sum(counters)
    assert counters["in"] == cameras.written and counters["lost"]["pair"] > 0
    assert counters["lost"]["pair"] == sum(counters["lost"].values())
    stop(saver)
    ranges = pictures(desk.folder / "range.y4m")
    field = WIDTH * HEIGHT
    pairs = [(picture[0], picture[2 * field]) for picture in ranges]
    assert all(right == left for right, left in pairs)
    assert counters["out"] == 2 * len(pairs)
    assert [left for _, left in pairs][-3:] == [last - 2, last - 1, last]
    taken = times(desk.folder / "range.y4m")
    steps = [time - taken[0] for time in taken]
    assert steps == [(left - pairs[0][1]) * PERIOD * 1000000 for _, left in pairs]


def test_a_few_frames_without_a_partner_are_not_reported(cameras: Cameras) -> None:
    """Each waits for 0.28 s, so that the last pair is more than a second old. The sixth in a row is reported, fewer are
    not, since a slow machine loses as many. A pair resets the count."""
    number = 0
    for lonely, lines in ((5, 0), (6, 1)):
        number = cameras.write_pairs(number + 1, 1)
        lost = cameras.settled()["lost"]["pair"]
        for frame in range(1, lonely + 1):
            number += 1
            cameras.write("left", number * PERIOD, number)
            assert cameras.settled()["lost"]["pair"] == lost + frame
        wait_until(lambda: cameras.said().count("no frames of the same time") >= lines)
        assert cameras.said().count("no frames of the same time") == lines
    assert "pairs again after" not in cameras.said()


def test_one_camera_is_missing(cameras: Cameras) -> None:
    """The other camera's frames are counted, and pairs are made again once the camera is back."""
    first = number = cameras.write_pairs(1, 1)
    before = cameras.settled()["lost"]["pair"]
    while "no frames of the same time" not in cameras.said():
        number += 1
        cameras.write("left", number * PERIOD, number)
        counters = cameras.settled()
        assert counters["lost"]["pair"] == before + number - first and counters["out"] == 2 and number < first + 100
    assert cameras.said().count("left, right: no frames of the same time, waiting for them\n") == 1
    late = cameras.write_pairs(number + 1, 1) - number - 1
    counters = cameras.settled()
    assert counters["out"] == 4 and counters["lost"]["pair"] == before + number - first + 2 * late
    wait_until(lambda: "left, right: pairs again after" in cameras.said())


def test_the_window_can_be_set(desk: Desk) -> None:
    """With 5 ms, frames 8 ms apart are no pair; frames 4 ms apart are one, with the left frame's number and time."""
    cameras = Cameras(desk, LEFT, "-window", 5)
    number, counters = 0, cameras.settled()
    while not counters["out"] and number < 100:
        number += 1
        cameras.write("left", number * PERIOD, number)
        cameras.write("right", number * PERIOD + {1: 8, 2: -8}.get(number, -4), 10 + number)
        counters = cameras.settled()
    assert counters["lost"]["pair"] == 2 * (number - 1) >= 4
    values = {name: json.loads(desk.run("ddxctl", "show", "--json", name).stdout)["value"]
              for name in ("left", "range", "range.disparity")}
    assert {(value["frame"], value["time"]) for value in values.values()} == {(number, values["left"]["time"])}
    cameras.end()


@pytest.mark.parametrize("cameras", ["64x18"], indirect=True)
def test_unequal_sizes(cameras: Cameras) -> None:
    """Reported once, and each frame is counted."""
    cameras.write_pair(0, 1)
    cameras.write_pair(PERIOD, 2)
    assert cameras.settled()["lost"]["picture"] == 4
    line = f"{SVS}: left has pictures of 64x16, right has 64x18: both must have the same size\n"
    assert cameras.said().count(line) == 1
    status, counters = stop(cameras.process)
    check_sum(counters)
    assert status == 0 and counters["out"] == 0
