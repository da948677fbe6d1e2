# SPDX-License-Identifier: GPL-2.0-or-later
"""-wire: bytes counted by a relay at several rates, losses at a rate that is far too low, and ddxctl's report."""
from __future__ import annotations

import functools
import pathlib
import re
from concurrent.futures import ThreadPoolExecutor

import numpy
import pytest

from parts.link.loss import NOTHING
from parts.media import clip as numbered_clip

from . import two_ends
from .programs import lost, stop, wait_until
from .stream import TO_RELAY, Stream, finish

pytestmark = pytest.mark.strict

WIRES = [100, 250, 2000]  # kbit/s
FRAMES, RATE, LARGE = 50, 25, 12


def make_noise(path: pathlib.Path, width: int, height: int, frames: int) -> pathlib.Path:
    """A clip of noise, which needs any rate."""
    random = numpy.random.default_rng(1)
    with path.open("wb") as file:
        file.write(f"YUV4MPEG2 W{width} H{height} F{RATE}:1 Ip A1:1\n".encode())
        for _ in range(frames):
            file.write(b"FRAME\n" + random.integers(0, 256, width * height * 3 // 2, numpy.uint8).tobytes())
    return path


@pytest.fixture(scope="module")
def noise(tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    return make_noise(tmp_path_factory.mktemp("noise") / "clip.y4m", 352, 288, FRAMES)


def test_no_more_than_the_rate_is_sent(tmp_path: pathlib.Path, noise: pathlib.Path) -> None:
    with ThreadPoolExecutor() as pool:
        runs = dict(zip(WIRES, pool.map(lambda wire: two_ends.run(tmp_path / str(wire), noise, NOTHING, NOTHING,
                                                                  "-wire", wire), WIRES)))
    for wire, run in runs.items():
        way = run.counts.down[0]
        print(f"{wire}: {way.bytes} bytes in {run.seconds:.1f} s, most {way.peak}, {run.sent}")
        assert run.disagreements(FRAMES) == [] and run.beyond_rate(wire) == []
        packets = run.shown_packets  # a busy machine reads repair packets first; restored packets then come twice
        assert packets["lost"] == packets["late"] and packets["restored"] <= packets["duplicate"]
    each = [run.counts.down[0].bytes / run.sent["out"] for run in runs.values()]  # bytes per frame
    assert each[0] < each[1] < each[2] and each[2] > 0.5 * WIRES[2] * 1000 / 8 / RATE  # the rate is used


def test_a_rate_that_is_far_too_low(stream: Stream) -> None:
    """Frames without rate left for them are counted, and no others are lost."""
    clip = make_noise(stream.folder / "large.y4m", 1920, 1080, LARGE)
    sender = stream.send("-wire", 50, "-preset", "ultrafast", *TO_RELAY)
    stream.play(clip)
    wait_until(lambda: two_ends.settled(stream.desk, "ddxvideosend", LARGE))
    (_, _, sent), = finish(sender)
    assert sent["in"] == LARGE == sent["out"] + lost(sent)
    assert sent["out"] > 0 and sent["lost"]["rate"] > 0
    assert sent["lost"]["encode"] == sent["lost"]["network"] == 0


def test_frames_of_mpeg4_fit_the_rate(stream: Stream) -> None:
    """Also without -bitrate. Its encoder does not keep to a size: with frames too large for the rate, nearly every
    second frame was lost as `lost.rate`."""
    clip = numbered_clip.write(stream.folder / "clip.y4m", 2)
    sender = stream.send("-codec", "mpeg4", "-wire", 400, *TO_RELAY)
    stream.play(clip)
    wait_until(lambda: two_ends.settled(stream.desk, "ddxvideosend", 2 * RATE))
    (_, _, sent), = finish(sender)
    print(sent)
    assert sent["lost"]["rate"] <= sent["in"] / 5


LINE = r"^(\w+) .*, wire \d+ kbit/s, repair \d+ %, video \d+ kbit/s, loss 0 %, runs of 0\.0$"


def test_ddxctl_shows_rate_and_repair(stream: Stream, noise: pathlib.Path) -> None:
    """While the sender runs; not for programs without these counters."""
    sender = stream.send("-wire", 250, "-repair", 1.5, *TO_RELAY)
    loader = stream.desk.start("ddxvideoload", noise, "-loop", "-readers", 1)
    wait_until(lambda: stream.desk.out("ddxvideosend") > 0)
    stats = functools.partial(stream.desk.stats, "ddxvideosend")
    wait_until(lambda: 50 < int(stats()["wire_kbit"]) <= 325 and 100 <= int(stats()["repair_percent"]) <= 200)
    text = stream.desk.run("ddxctl", "stats").stdout
    assert re.findall(LINE, text, re.MULTILINE) == ["ddxvideosend"]
    assert "wire_kbit" not in stream.desk.stats("ddxvideoload")
    assert stop(loader)[0] == 0
    finish(sender)
    assert "wire_kbit" not in stats() and "kbit/s" not in stream.desk.run("ddxctl", "stats").stdout
