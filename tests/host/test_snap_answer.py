# SPDX-License-Identifier: GPL-2.0-or-later
"""Pictures on request: `ddxvideosnap -answer` gives the newest frame, never the same one again."""
from __future__ import annotations

import pathlib
import subprocess
import time
from collections.abc import Iterator

import pytest

from parts.common import MORTAL
from parts.media import clip as numbered_clip

from .programs import ROOT, Desk, lost, send_signal, start_recorder, stop, wait_for_recorder

pytestmark = pytest.mark.retry


class Answering:
    """The program, and its answers; ends with its input."""

    def __init__(self, desk: Desk, *options: str) -> None:
        self.process = subprocess.Popen([*MORTAL, ROOT / "bin/ddxvideosnap", "-answer", *options], cwd=desk.folder,
                                        env=desk.environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                        stderr=subprocess.PIPE)

    def ask(self, request: str) -> tuple[list[str], bytes]:
        """The words of an answer, and its picture."""
        assert self.process.stdin and self.process.stdout
        self.process.stdin.write(f"{request}\n".encode())
        self.process.stdin.flush()
        words = self.process.stdout.readline().decode().split()
        picture = self.process.stdout.read(int(words[5])) if words[:1] == ["picture"] else b""
        return words, picture

    def end(self) -> tuple[int, bytes, bytes]:
        out, errors = self.process.communicate(timeout=60)
        return self.process.returncode, out, errors


@pytest.fixture
def clip(tmp_path: pathlib.Path) -> pathlib.Path:
    path = tmp_path / "clip.y4m"
    with path.open("wb") as file:
        file.write(b"YUV4MPEG2 W352 H288 F25:1 Ip A1:1 C420jpeg\n")
        for number in range(8):
            file.write(b"FRAME\n" + numbered_clip.picture(number))
    return path


@pytest.fixture
def played(desk: Desk, clip: pathlib.Path) -> Iterator[Desk]:
    """An item whose source has stopped after 8 frames."""
    assert desk.run("ddxvideoload", clip).returncode == 0
    yield desk


def number_in(picture: bytes, scale: int = 1) -> int | None:
    """The frame's number that FFmpeg finds in a JPEG; with scale 2 it is half as large as the clip."""
    gray = subprocess.run(["ffmpeg", "-v", "error", "-f", "mjpeg", "-i", "-", "-vf",
                           f"scale=iw*{scale}:ih*{scale}:flags=neighbor", "-f", "rawvideo", "-pix_fmt", "gray", "-"],
                          input=picture, capture_output=True, check=True).stdout
    assert len(gray) == 352 * 288
    return numbered_clip.frame_number(gray, 352, 288)


def test_the_newest_frame_and_no_other(played: Desk) -> None:
    answering = Answering(played)
    words, picture = answering.ask("0 3 1")
    kind, sequence, frame, age, lost, size = words
    assert (kind, sequence, frame, lost, int(size)) == ("picture", "8", "7", "0", len(picture))
    assert picture[:2] == b"\xff\xd8" and picture[-2:] == b"\xff\xd9" and number_in(picture) == 7
    coarse, coarse_picture = answering.ask("0 16 1")
    half, half_picture = answering.ask("0 16 2")
    assert number_in(coarse_picture) == 7 and number_in(half_picture, 2) == 7
    assert len(half_picture) < len(coarse_picture) < len(picture)
    assert int(age) < int(coarse[3]) < int(half[3])  # of the frame, not of the answer
    assert answering.ask("8 3 1") == (["nothing"], b"")
    assert answering.ask("9 3 1")[0][1] == "8"  # of a store that was lost
    # The source's number of a frame, and its losses.
    assert played.run("ddxctl", "set", "video", "frame=42", "source_lost=5").returncode == 0
    words, picture = answering.ask("8 3 1")
    assert (words[1], words[2], words[4]) == ("9", "42", "5") and number_in(picture) == 7
    assert answering.end() == (0, b"", b"")


def test_it_waits_for_the_next_frame(played: Desk, clip: pathlib.Path) -> None:
    answering = Answering(played)
    recorder = start_recorder(played, "-output", "recorded.y4m")
    wait_for_recorder(played)
    loader = played.start("ddxvideoload", clip, "-loop", "-readers", "1")
    after, seen = 8, 0
    while seen < 12:
        words, picture = answering.ask(f"{after} 6 1")
        if words == ["nothing"]:  # the loader has not begun
            continue
        assert words[0] == "picture" and int(words[1]) > after
        assert number_in(picture) == int(words[2]) % 8
        after, seen = int(words[1]), seen + 1
    assert answering.end() == (0, b"", b"")
    # No frame is lost elsewhere.
    loaded, saved = stop(loader)[1], stop(recorder)[1]
    assert lost(loaded) == lost(saved) == 0 and loaded["out"] == 8 + saved["out"] >= 8 + seen


def test_refusals(played: Desk) -> None:
    for options, reason in (["-name", "missing"], "no item of this name"), (["-name", "ddxvideoload.stats"], "type"):
        answering = Answering(played, *options)
        words, _ = answering.ask("0 6 1")
        assert words[0] == "refused" and reason in " ".join(words)
        assert answering.end() == (1, b"", b"")
    for request in ("", "0", "0 6", "0 1 1", "0 32 1", "0 6 3", "0 6 0", "-1 6 1", "0 6 1 1", "x 6 1",
                    "0 6 1" + " " * 99):
        answering = Answering(played)
        answering.ask(request)
        status, out, errors = answering.end()
        assert (status, out, errors.count(b"\n")) == (2, b"", 1), request
    for given in ("-answer x.jpg", "-answer -montage", ""):
        assert played.run("ddxvideosnap", *given.split()).returncode == 2
    # A store that is lost, at once or soon.
    answering = Answering(played)
    assert answering.ask("0 6 1")[0][0] == "picture"
    send_signal(played.store, 9)
    begin = time.monotonic()
    while (words := answering.ask("8 6 1")[0]) == ["nothing"]:
        assert time.monotonic() - begin < 60
    assert words[0] == "refused"
    assert answering.end()[0] == 1
