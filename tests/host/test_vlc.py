# SPDX-License-Identifier: GPL-2.0-or-later
"""Debian's VLC and FFmpeg play the stream as MPEG-TS, by its address or its announcement; judged by the numbers in
their pictures."""
from __future__ import annotations

import os
import pathlib
import re
import subprocess
import tempfile
from collections.abc import Iterator

import pytest

from parts.common import MORTAL
from parts.media import clip as numbered_clip

from .absent import need
from .programs import Process, pictures, wait_until
from .stream import GROUP, Stream
from .test_stream_players import FRAMES, SECONDS, follows

PORT_TS = 8100
ENOUGH = 60  # pictures
VLC = ["vlc", "-I", "cli", "--no-audio", "--vout", "yuv", "--yuv-chroma", "I420", "--yuv-yuv4mpeg2", "--yuv-file"]
BYTES = 352 * 288 * 3 // 2 + len("FRAME\n")

pytestmark = [pytest.mark.retry, pytest.mark.long]


@pytest.fixture(params=["h264", "mpeg4"])
def sent(tmp_path: pathlib.Path, request: pytest.FixtureRequest) -> Iterator[Stream]:
    """A continuous stream."""
    stream = Stream(tmp_path)
    subprocess.run([*stream.network.inside, "ip", "addr", "add", "10.0.0.1/32", "dev", "lo"], check=True)
    clip = numbered_clip.write(tmp_path / "clip.y4m", SECONDS)
    stream.send("-codec", request.param, "-bitrate", "800", "-ts", PORT_TS, "-sdp", "stream.sdp")
    stream.desk.start("ddxvideoload", clip, "-loop", "-readers", "1")
    wait_until((tmp_path / "stream.sdp").exists)
    yield stream
    stream.end()


def check(y4m: pathlib.Path) -> None:
    """Check the numbers; VLC repeats pictures at its start."""
    numbers = [numbered_clip.frame_number(picture, 352, 288) for picture in pictures(y4m)]
    assert follows(numbers[-ENOUGH // 2:], 20), numbers


class Vlc:
    def __init__(self, stream: Stream, *words: str) -> None:
        need("vlc", "vlc-bin")
        # VLC refuses to run as root, and another user cannot access the test's folder.
        self.keeper = tempfile.TemporaryDirectory(prefix="ddx-")
        self.folder = pathlib.Path(self.keeper.name)
        self.folder.chmod(0o777)
        self.y4m = self.folder / "seen.y4m"
        user = ["setpriv", "--reuid=65534", "--regid=65534", "--clear-groups"] if os.geteuid() == 0 else []
        self.out = open(self.folder / "out", "w+")
        self.process: Process = subprocess.Popen(
            [*MORTAL, *stream.network.inside, *user, *VLC, str(self.y4m), *words], cwd=self.folder, text=True,
            env={"HOME": str(self.folder), "PATH": os.environ["PATH"], "TERM": "dumb"}, stdin=subprocess.PIPE,
            stdout=self.out, stderr=subprocess.STDOUT)

    def type(self, line: str) -> None:
        assert self.process.stdin
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()

    def printed(self) -> str:
        return (self.folder / "out").read_text(errors="replace")

    def watch(self) -> None:
        """Wait until it has shown enough pictures."""
        wait_until(lambda: self.y4m.exists() and self.y4m.stat().st_size > ENOUGH * BYTES)
        self.type("quit")
        self.process.communicate(timeout=60)
        check(self.y4m)


def test_vlc_by_address(sent: Stream) -> None:
    Vlc(sent, f"rtp://@{GROUP}:{PORT_TS}").watch()


def test_vlc_by_announcement(sent: Stream) -> None:
    """Played from VLC's list of network streams."""
    vlc = Vlc(sent, "--services-discovery", "sap")

    def number() -> str:
        vlc.type("playlist")
        match = re.search(r"(\d+) - .* ddxvideosend MPEG-TS", vlc.printed())
        return match[1] if match else ""
    wait_until(lambda: bool(number()))
    vlc.type(f"goto {number()}")
    vlc.watch()


def test_ffmpeg_by_address(sent: Stream) -> None:
    command = ["ffmpeg", "-v", "error", "-nostdin", "-i", f"rtp://{GROUP}:{PORT_TS}", "-frames:v", str(FRAMES),
               "-fps_mode", "passthrough", "-pix_fmt", "yuv420p", "-y", "seen.y4m"]
    subprocess.run([*sent.network.inside, *command], cwd=sent.folder, check=True, timeout=60)
    check(sent.folder / "seen.y4m")
