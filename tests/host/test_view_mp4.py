# SPDX-License-Identifier: GPL-2.0-or-later
"""ddxvideoview shows MP4 recordings frame by frame, though their frames refer to earlier ones."""
from __future__ import annotations

import os
import pathlib

import pytest

from parts.media.display import Display

from .mp4 import fragments
from .programs import Desk, lost, pictures, result, start_recorder, stop, wait_for_recorder
from .test_mp4 import even, write
from .test_mp4_pool import GAP, files
from .test_snap import rgb
from .test_view import check, display, make_clip
from .window import Window

pytestmark = pytest.mark.strict

__all__ = ["display"]  # the fixture

FRAMES = 30
STEP = 100_000_000  # ns: a key frame is a second after the one before


@pytest.fixture
def recording(desk: Desk) -> pathlib.Path:
    """Lossless, of pictures with their numbers; key frames are 0, 10 and 20."""
    plain = make_clip(desk.folder / "plain.y4m", FRAMES)
    head = plain.read_bytes().split(b"\n", 1)[0]
    clip = desk.folder / "clip.y4m"
    clip.write_bytes(head + b"\n" + b"".join(b"FRAME XTIME=%d\n" % (number * STEP) + picture
                                             for number, picture in enumerate(pictures(plain))))
    saver = start_recorder(desk, "-output", "out.mp4", "-quality", "0")
    wait_for_recorder(desk)
    assert desk.run("ddxvideoload", clip, "-rate", "0", "-readers", "1").returncode == 0
    status, counters = stop(saver)
    assert (status, counters["out"], lost(counters)) == (0, FRAMES, 0)
    path = desk.folder / "out.mp4"
    assert [number for number, frame in enumerate(fragments(path.read_bytes())) if frame.key] == [0, 10, 20]
    return path


@pytest.mark.parametrize("memory", ["256M", "1M"])
def test_steps(desk: Desk, display: Display, recording: pathlib.Path, memory: str) -> None:
    """Also over key frames, and with room for six pictures, fewer than from key frame to key frame."""
    window = Window(desk, display, recording, "-memory", memory)
    check(window.press("Home", "space", "End"), 29, "PAUSED", "PLAYING")
    for number in range(28, 7, -1):
        check(window.press("comma"), number, "PAUSED")
    check(window.press("s", "Right"), 18, "PAUSED")
    check(window.press("Home", *["period"] * 11), 11, "PAUSED")
    check(window.press("Left", "comma", "comma"), 0, "PAUSED")
    check(window.press("End", "Left", "period"), 20, "PAUSED")
    check(window.press("Left", "End", "Left", "comma", "period", "period", "period"), 21, "PAUSED")
    check(window.press("Home", *["period"] * 8, "Right", *["period"] * 3), 21, "PAUSED")
    window.close()
    assert result(window.process)[0] == 0
    if memory == "1M":
        return
    window = Window(desk, display, desk.folder / "plain.y4m")
    check(window.press("Home", "space", "Home", *["period"] * 8), 8, "PAUSED")
    (desk.folder / "out-000008.png").rename(desk.folder / "coded.png")
    window.press("s")
    assert (rgb(desk.folder / "coded.png") == rgb(desk.folder / "plain-000008.png")).all()
    window.close()
    assert result(window.process)[0] == 0


def test_a_damaged_picture(desk: Desk, display: Display, recording: pathlib.Path) -> None:
    """It is named, and so are those that refer to it; the other ones are shown. The file ends within a frame."""
    data = bytearray(recording.read_bytes())
    frames = fragments(bytes(data))
    data[frames[13].offset + 200:frames[13].offset + 400] = bytes(200)
    data[32:48] = bytes([0, 0, 0, 16]) + b"free" + bytes(8)
    recording.write_bytes(data[:frames[29].offset + 5])
    window = Window(desk, display, recording)
    end = window.press("Home", "space", "End")
    check(end, 28, "PAUSED", "PLAYING")
    assert "cut short after frame 28" in end.text, end.text
    check(window.press("Home", *["period"] * 12), 12, "PAUSED")
    bad = window.press("period")
    assert bad.number() is None and "frame 13 cannot be decoded" in bad.text, bad.text
    bad = window.press("period", "period")
    assert bad.number() is None and "frame 15 cannot be decoded: frame 13, to which it refers, is damaged" in bad.text
    check(window.press(*["period"] * 5), 20, "PAUSED")
    bad = window.press("comma")
    assert bad.number() is None and "frame 19 cannot be decoded: frame 13" in bad.text, bad.text
    check(window.press(*["comma"] * 7), 12, "PAUSED")
    window.close()
    assert result(window.process)[0] == 0


def test_a_recording_of_several_files(desk: Desk, display: Display, tmp_path: pathlib.Path) -> None:
    """They open from any of their names; a copy elsewhere is shown alone."""
    (desk.folder / "rec").mkdir()
    saver = start_recorder(desk, "-output", "rec", "-segment", "4", "-format", "h264")
    wait_for_recorder(desk)
    write(desk, even(3) + even(3, GAP) + even(3, 2 * GAP))
    assert stop(saver)[0] == 0
    named = files(desk)
    assert len(named) == 3
    window = Window(desk, display, named[1])
    assert window.press("Home", "space", "End").frame() == 8
    assert [window.press("comma").frame() for _ in range(7)] == [7, 6, 5, 4, 3, 2, 1]
    window.close()
    assert result(window.process)[0] == 0
    copy = desk.folder / "copy.mp4"
    copy.write_bytes(named[2].read_bytes())
    for index in (desk.folder / "rec/pool").glob("*.index"):
        os.truncate(index, 100)
    for path, last in (copy, 8), (named[0], 2):
        window = Window(desk, display, path)
        assert window.press("Home", "space", "End").frame() == last
        assert window.press("Home").frame() == last - 2
        window.close()
        assert result(window.process)[0] == 0
