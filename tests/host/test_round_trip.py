# SPDX-License-Identifier: GPL-2.0-or-later
"""Recorded frames and times equal the played ones."""
from __future__ import annotations

import itertools
import json
import pathlib
import signal
import subprocess
import time

import pytest

from parts.common import MORTAL

from .programs import (ROOT, Counters, Desk, ffmpeg, frame_md5, header_of, lost, make_clip, pictures, record, result,
                       start_recorder, stop, times, wait_until)

pytestmark = pytest.mark.strict

MILLISECOND = 1_000_000
# Makes FFmpeg's converter equal ours: chroma samples lie on the left luma column before and after.
SAME_CONVERSION = ("scale=in_h_chr_pos=0:out_h_chr_pos=0:"
                   "flags=bicubic+accurate_rnd+full_chroma_inp+bitexact")
PLAIN: dict[str, list[str]] = {"C420jpeg": [], "C420mpeg2": ["-chroma_sample_location", "left"],
                               "C420paldv": ["-chroma_sample_location", "topleft"]}
CONVERTED = ["yuv411p", "yuv422p", "yuv444p", "gray", "gray9le", "gray10le", "gray12le", "gray16le"] + [
    f"yuv{chroma}p{bits}le" for chroma in (420, 422, 444) for bits in (9, 10, 12, 14, 16)]


def test_frames_and_times(desk: Desk) -> None:
    clip = make_clip(desk.folder / "clip.y4m", frames=50)
    first, second = desk.folder / "first.y4m", desk.folder / "second.y4m"
    loaded, saved = record(desk, clip, first, instance="one")
    for counters in (loaded, saved):
        assert (counters["in"], counters["out"], lost(counters), counters["waiting"]) == (50, 50, 0, 0)
    assert pictures(first) == pictures(clip)
    assert frame_md5(first) == frame_md5(clip)
    assert times(first) == [n * 40 * MILLISECOND for n in range(50)]

    # Playing the recording and recording it again gives an equal file.
    record(desk, first, second, instance="two")
    assert pictures(second) == pictures(first)
    assert times(second) == times(first)
    assert header_of(second) == header_of(first)
    assert header_of(first) == "YUV4MPEG2 W352 H288 F25:1 Ip A1:1 C420jpeg"


def test_uneven_times_are_kept(desk: Desk) -> None:
    """A frame is due by its recorded time, not by the frame rate."""
    clip = make_clip(desk.folder / "clip.y4m", size="64x48", frames=6)
    steps = [0, 1_234_567, 150_000_001, 150_000_002, 400_000_000, 400_000_000]
    parts = clip.read_bytes().split(b"FRAME\n")
    clip.write_bytes(parts[0] + b"".join(b"FRAME XTIME=%d\n%s" % pair for pair in zip(steps, parts[1:])))
    loaded, _ = record(desk, clip, desk.folder / "out.y4m")
    assert times(desk.folder / "out.y4m") == steps
    check_pace(loaded, 0.4)
    check_on_time(loaded)


def check_pace(loaded: Counters, seconds: float) -> None:
    """Check that the clip was not played faster. On a busy machine the first frame may be late, as any other."""
    late = loaded["latency_us"]["max"] * 1000
    assert loaded["last_ns"] - loaded["first_ns"] + late > seconds * 1e9 - MILLISECOND


def check_on_time(loaded: Counters) -> None:
    """Check that half of the frames are on time, even on a busy machine."""
    assert loaded["latency_us"]["p50"] < 100_000


@pytest.mark.parametrize("rate,frames,seconds",
                         [("1", 13, 0.48), ("2", 25, 0.48), ("0.5", 13, 0.96), ("29.97", 100, 0.132)])
def test_rate(desk: Desk, rate: str, frames: int, seconds: float) -> None:
    clip = make_clip(desk.folder / "clip.y4m", size="64x48", frames=frames)
    loaded, _ = record(desk, clip, desk.folder / "out.y4m", "-rate", rate, keep=100)  # 750 a second
    check_pace(loaded, seconds)
    check_on_time(loaded)
    assert times(desk.folder / "out.y4m")[-1] == pytest.approx(seconds * 1e9, rel=0.01)


def test_ntsc_rate_is_exact(desk: Desk) -> None:
    clip = make_clip(desk.folder / "clip.y4m", size="64x48", rate="30000/1001", frames=31)
    record(desk, clip, desk.folder / "out.y4m", "-rate", "4")
    header = header_of(desk.folder / "out.y4m")
    assert " F30000:1001 " in header
    assert times(desk.folder / "out.y4m") == [n * 1001 * 1_000_000_000 // 30000 // 4 for n in range(31)]


def test_rate_zero_does_not_wait(desk: Desk) -> None:
    clip = make_clip(desk.folder / "clip.y4m", size="64x48", frames=500)
    assert desk.run("ddxvideoload", clip, "-rate", "0").returncode == 0
    assert desk.stats("ddxvideoload")["out"] == 500


def test_after_a_stall_it_catches_up_at_twice_its_pace(desk: Desk) -> None:
    """A burst would be lost except for the frames that the store keeps."""
    clip = make_clip(desk.folder / "clip.y4m", size="64x48", rate="50", frames=75)
    loader = desk.start("ddxvideoload", clip, "-readers", "1")
    wait_until(lambda: "video.frame" in desk.run("ddxctl", "list").stdout)
    watcher = desk.start("ddxctl", "watch", "video", "-json", "-count", "60")
    wait_until(lambda: desk.out("ddxvideoload") > 10)
    loader.send_signal(signal.SIGSTOP)
    time.sleep(0.6)
    loader.send_signal(signal.SIGCONT)
    assert result(loader)[1]["out"] == 75
    watcher.terminate()
    writes = [json.loads(line) for line in watcher.communicate()[0].splitlines()]
    steps = [(later["time_ns"] - one["time_ns"], later["sequence"] - one["sequence"])
             for one, later in itertools.pairwise(writes)]
    assert max(took for took, _ in steps) > 500 * MILLISECOND
    assert all(took >= frames * 10 * MILLISECOND for took, frames in steps)


def test_a_loop_continues_times_and_numbers(desk: Desk) -> None:
    """Times and numbers of the second pass continue those of the first without a gap."""
    clip = make_clip(desk.folder / "clip.y4m", size="64x48", rate="100", frames=10)
    saver = start_recorder(desk, "-output", "out.y4m")
    loader = desk.start("ddxvideoload", clip, "-loop", "-readers", "1")
    wait_until(lambda: desk.out("ddxvideoload") > 60)
    status, counters = stop(loader)
    assert status == 0 and counters["in"] == counters["out"] > 50
    assert stop(saver)[0] == 0
    recorded = desk.folder / "out.y4m"
    assert times(recorded) == [n * 10 * MILLISECOND for n in range(counters["out"])]
    assert pictures(recorded) == (pictures(clip) * 100)[:counters["out"]]
    shown = desk.run("ddxctl", "show", "video.frame").stdout
    assert str(counters["out"] - 1) in shown


@pytest.mark.parametrize("tag", PLAIN)
def test_every_siting_is_untouched(desk: Desk, tag: str) -> None:
    clip = make_clip(desk.folder / "clip.y4m", "64x48", "100", 10, "yuv420p", *PLAIN[tag])
    assert tag in header_of(clip).split()
    record(desk, clip, desk.folder / "out.y4m")
    assert tag in header_of(desk.folder / "out.y4m").split()
    assert pictures(desk.folder / "out.y4m") == pictures(clip)


@pytest.mark.parametrize("facts", ["Ip A128:117", "It A1:1 XCOLORRANGE=LIMITED", "Ib A0:0 XCOLORRANGE=FULL",
                                   "I? A12:11 XDDX_FIELDS=3"])
def test_header_parameters_are_kept(desk: Desk, facts: str) -> None:
    clip, out = make_clip(desk.folder / "clip.y4m", "64x48", "100", 4), desk.folder / "out.y4m"
    data = clip.read_bytes()
    clip.write_bytes(f"YUV4MPEG2 W64 H48 F100:1 {facts} C420mpeg2\n".encode() + data[data.index(b"\n") + 1:])
    record(desk, clip, out)
    assert sorted(header_of(out).split()) == sorted(header_of(clip).split())
    assert pictures(out) == pictures(clip)


@pytest.mark.parametrize("format", CONVERTED)
def test_every_layout_is_converted(desk: Desk, format: str) -> None:
    clip = make_clip(desk.folder / "clip.y4m", "84x48", "100", 5, format)
    out = desk.folder / "out.y4m"
    record(desk, clip, out)
    ours, luma = pictures(out), 84 * 48
    assert len(ours) == 5
    if format == "gray":
        assert [picture[:luma] for picture in ours] == [picture for picture in frames_of(clip, luma)]
        assert all(set(picture[luma:]) == {128} for picture in ours)
        return
    theirs = ffmpeg("-i", clip, "-vf", f"{SAME_CONVERSION},format={'gray' if 'gray' in format else 'yuv420p'}",
                    "-f", "rawvideo", "-")
    size = len(theirs) // 5
    for number, picture in enumerate(ours):
        reference = theirs[number * size:(number + 1) * size]
        # FFmpeg treats mono as full-range grey and rounds down; otherwise the converters agree.
        assert difference(picture[:size], reference) < (0.6 if "gray" in format else 0.01)


def frames_of(clip: pathlib.Path, size: int) -> list[bytes]:
    data = clip.read_bytes()
    body = data[data.index(b"\n") + 1:]
    step = size + len(b"FRAME\n")
    return [body[at + 6:at + step] for at in range(0, len(body), step)]


def difference(a: bytes, b: bytes) -> float:
    """Mean absolute difference of samples."""
    assert len(a) == len(b)
    return sum(abs(x - y) for x, y in zip(a, b)) / len(a)


def test_alpha_is_left_out(desk: Desk) -> None:
    clip = make_clip(desk.folder / "clip.y4m", "64x48", "100", 3, "yuv444p")
    head, *frames = clip.read_bytes().split(b"FRAME\n")
    with_alpha = desk.folder / "alpha.y4m"
    alpha = b"\x55" * 64 * 48
    with_alpha.write_bytes(head.replace(b"C444", b"C444alpha") + b"".join(b"FRAME\n" + f + alpha for f in frames))
    record(desk, clip, desk.folder / "out.y4m", instance="one")
    record(desk, with_alpha, desk.folder / "alpha-out.y4m", instance="two")
    assert pictures(desk.folder / "alpha-out.y4m") == pictures(desk.folder / "out.y4m")


def test_from_a_pipe(desk: Desk) -> None:
    clip = make_clip(desk.folder / "clip.y4m", "64x48", "100", 10)
    with open(clip, "rb") as source, subprocess.Popen(["cat"], stdin=source, stdout=subprocess.PIPE) as cat:
        saver = start_recorder(desk, "-output", "out.y4m")
        subprocess.run([*MORTAL, ROOT / "bin/ddxvideoload", "/dev/stdin", "-readers", "1"], env=desk.environment,
                       stdin=cat.stdout, check=True, capture_output=True)
    assert stop(saver)[0] == 0
    assert pictures(desk.folder / "out.y4m") == pictures(clip)


@pytest.mark.parametrize("size", ["2x2", "16x16", "1920x1080", "3840x2160"])
def test_sizes(tmp_path: pathlib.Path, size: str) -> None:
    """From the smallest picture to one larger than the paper's struct."""
    desk = Desk(tmp_path, memory="512M")
    try:
        clip = make_clip(tmp_path / "clip.y4m", size, "10", 4)
        loaded, saved = record(desk, clip, tmp_path / "out.y4m", keep=8)
        assert saved["out"] == 4 and lost(saved) == 0
        assert frame_md5(tmp_path / "out.y4m") == frame_md5(clip)
    finally:
        desk.end()
