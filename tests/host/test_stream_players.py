# SPDX-License-Identifier: GPL-2.0-or-later
"""Debian's players open a stream by its .sdp file, with repair packets at the next port; judged by their pictures."""
from __future__ import annotations

import json
import os
import pathlib
import subprocess
from collections.abc import Iterator

import numpy
import pytest

from parts.common import MORTAL
from parts.media import clip as numbered_clip

from .programs import ROOT, Desk, pictures, wait_until
from .stream import Stream, make_key

pytestmark = pytest.mark.retry

SECONDS = 4
FRAMES = SECONDS * numbered_clip.RATE
CODECS = ["h264", "mpeg4"]
JOIN = 5  # s until the first whole picture: H.264 is renewed column by column


@pytest.fixture(params=CODECS)
def sent(tmp_path: pathlib.Path, clip: pathlib.Path, request: pytest.FixtureRequest) -> Iterator[Stream]:
    """A continuous stream with its description in stream.sdp."""
    stream = Stream(tmp_path)
    send(stream, clip, "-codec", request.param)
    yield stream
    stream.end()


def send(stream: Stream, clip: pathlib.Path, *options: str) -> None:
    stream.send("-wire", "1600", "-repair", "1", "-bitrate", "800", "-sdp", "stream.sdp", *options)
    stream.desk.start("ddxvideoload", clip, "-loop", "-readers", "1")
    wait_until((stream.folder / "stream.sdp").exists)


def run(stream: Stream, *command: str) -> str:
    return subprocess.run([*stream.network.inside, *command], cwd=stream.folder, check=True, timeout=60, text=True,
                          stdout=subprocess.PIPE).stdout


WHITELIST = ["-protocol_whitelist", "file,udp,rtp"]


def follows(numbers: list[int | None], least: int) -> bool:
    """Whether the numbers follow the clip; a few pictures may be dropped or repeated."""
    steps = [(b - a) % FRAMES for a, b in zip(numbers, numbers[1:]) if a is not None and b is not None]
    return len(steps) >= least and all(step < FRAMES // 2 for step in steps) and steps.count(0) < least // 2


def test_the_check_of_numbers() -> None:
    assert follows([97, 98, 99, 0, 1, 2, 2, 4], 6)
    assert not follows([97, 98, 99], 6) and not follows([7, 7, 7, 7, 7, 7, 7, 7], 6)
    assert not follows([5, 4, 3, 2, 1, 0, 1, 0], 6) and not follows([None] * 8, 6)


def test_ffprobe(sent: Stream) -> None:
    shown = json.loads(run(sent, "ffprobe", "-v", "error", *WHITELIST, "-show_streams", "-show_frames", "-of", "json",
                           "-read_intervals", f"%+#{JOIN * numbered_clip.RATE + 50}", "stream.sdp"))
    assert (shown["streams"][0]["width"], shown["streams"][0]["height"]) == (352, 288)
    assert len(shown["frames"]) > 20
    packets = sent.packets("ddxvideosend")
    assert packets["repairs"] > packets["media"] / 2


def ffmpeg_numbers(stream: Stream) -> list[int | None]:
    """The numbers in the last 30 of 80 pictures: FFmpeg may join between key frames, and shows grey until the next."""
    run(stream, "ffmpeg", "-v", "error", "-nostdin", *WHITELIST, "-i", "stream.sdp", "-frames:v", "80", "-fps_mode",
        "passthrough", "-pix_fmt", "yuv420p", "-y", "seen.y4m")
    return [numbered_clip.frame_number(picture, 352, 288) for picture in pictures(stream.folder / "seen.y4m")[-30:]]


def test_ffmpeg(sent: Stream) -> None:
    assert follows(ffmpeg_numbers(sent), 25)


def test_ffmpeg_with_a_key(stream: Stream, clip: pathlib.Path) -> None:
    """Uses FFmpeg's SRTP, with the key in the description."""
    make_key(stream.folder / "stream.key")
    send(stream, clip, "-codec", "mpeg4", "-key", "stream.key")
    assert "a=crypto:" in (stream.folder / "stream.sdp").read_text()
    assert follows(ffmpeg_numbers(stream), 25)


def number_in_bmp(path: pathlib.Path) -> int | None:
    """The number in a window's picture: 24 or 32 bits a pixel, bottom up; uses green as luma."""
    data = path.read_bytes()
    assert len(data) == int.from_bytes(data[2:6], "little")
    begin, width, height = (int.from_bytes(data[at:at + 4], "little") for at in (10, 18, 22))
    depth = int.from_bytes(data[28:30], "little") // 8
    rows = numpy.frombuffer(data, numpy.uint8, offset=begin).reshape(height, -1)[::-1, :width * depth]
    return numbered_clip.frame_number(rows[:, 1::depth].tobytes(), width, height)


def window_numbers(folder: pathlib.Path) -> list[int | None]:
    """The numbers in the latest pictures."""
    found = sorted(folder.glob("SDL_window*.bmp"), key=lambda path: int(path.stem.split("-")[-1]))
    return [number_in_bmp(path) for path in found[-31:-1]]  # the last file may be incomplete


def watch_window(process: subprocess.Popen[bytes], folder: pathlib.Path, enough: int = 110) -> list[int | None]:
    """The numbers in a player's window after `enough` pictures; stops the player."""
    wait_until(lambda: len(list(folder.glob("SDL_window*.bmp"))) > enough, 60)
    process.terminate()
    process.communicate(timeout=60)
    return window_numbers(folder)


# SDL's dummy screen writes each picture of the window to a file.
SCREEN = {"SDL_VIDEODRIVER": "dummy", "SDL_VIDEO_DUMMY_SAVE_FRAMES": "1"}


def test_ffplay(sent: Stream) -> None:
    player = ["ffplay", "-v", "error", "-an", *WHITELIST, "stream.sdp"]
    process = subprocess.Popen([*MORTAL, *sent.network.inside, *player], cwd=sent.folder, env={**os.environ, **SCREEN})
    assert follows(watch_window(process, sent.folder), 20)


def test_decode_window(sent: Stream) -> None:
    """ddxdecode's window on the same screen."""
    process = subprocess.Popen([*MORTAL, *sent.network.inside, "env", *(f"{k}={v}" for k, v in SCREEN.items()),
                                ROOT / "bin/ddxdecode", "-instance", "window"], cwd=sent.folder,
                               env=sent.desk.environment, stdout=subprocess.PIPE)
    assert follows(watch_window(process, sent.folder), 25)
    assert process.returncode == 0


def test_gstreamer(sent: Stream) -> None:
    """Uses its demuxer, jitter buffer and depacketiser; FFmpeg decodes the result."""
    h264 = "H264" in (sent.folder / "stream.sdp").read_text()
    chain = ["rtph264depay", "!", "h264parse", "!", "video/x-h264,stream-format=byte-stream"] if h264 else \
        ["rtpmp4vdepay"]
    subprocess.run([*sent.network.inside, "timeout", "--preserve-status", "--signal=INT", str(JOIN + 3),
                    "gst-launch-1.0", "-q", "-e", "filesrc", "location=stream.sdp", "!", "sdpdemux", "!", *chain, "!",
                    "filesink", "location=seen.es"], cwd=sent.folder, timeout=60, check=False)
    run(sent, "ffmpeg", "-v", "error", "-nostdin", "-f", "h264" if h264 else "m4v", "-i", "seen.es", "-fps_mode",
        "passthrough", "-pix_fmt", "yuv420p", "-y", "seen.y4m")
    numbers = [numbered_clip.frame_number(picture, 352, 288) for picture in pictures(sent.folder / "seen.y4m")]
    assert follows(numbers[-30:], 25)


@pytest.mark.parametrize("driver, why", [
    ("none", ""), (None, "neither DISPLAY nor WAYLAND_DISPLAY is set")])
def test_without_sdl(desk: Desk, driver: str | None, why: str) -> None:
    """Without a screen, as in the image, ddxdecode reports it in one line and receives the stream."""
    environment = {key: value for key, value in desk.environment.items()
                   if key not in ("DISPLAY", "WAYLAND_DISPLAY", "XDG_RUNTIME_DIR")}
    process = subprocess.Popen([*MORTAL, ROOT / "bin/ddxdecode", "-group", "none"], stdout=subprocess.PIPE,
                               env={**environment, **({"SDL_VIDEODRIVER": driver} if driver else {})},
                               stderr=subprocess.PIPE, text=True)
    assert process.stderr and process.stderr.readline().startswith(f"ddxdecode: no window is shown: {why}")
    process.terminate()
    out, more = process.communicate(timeout=60)
    assert process.returncode == 0 and '"instance":"ddxdecode"' in out and not more


def test_a_network_without_a_default_route(stream: Stream, clip: pathlib.Path) -> None:
    """Sender, ddxdecode and its list name the option that is missing."""
    subprocess.run([*stream.network.inside, "ip", "route", "flush", "224.0.0.0/4"], check=True)
    sender, decode = stream.send(), stream.decode()
    stream.play(clip, "-rate", "0")
    for process in (sender, decode):
        wait_until(lambda: "name the network's interface: -interface" in stream.desk.errors(process))
    subprocess.run([*stream.network.inside, "ip", "link", "set", "lo", "down"], check=True)  # no route of IPv6 either
    listed = stream.desk.start("ddxdecode", "-list", wrapper=stream.network.inside)
    assert listed.wait(60) == 1 and "-interface" in stream.desk.errors(listed)
