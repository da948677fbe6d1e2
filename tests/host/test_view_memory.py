# SPDX-License-Identifier: GPL-2.0-or-later
"""ddxvideoview keeps a limited number of frames of a live source, in limited memory."""
import os
import pathlib
import re
import time
from collections.abc import Callable

import pytest

from parts.media.display import Display

from .programs import Desk, result
from .test_view import check, display, make_clip, play
from .window import Window

pytestmark = pytest.mark.retry

__all__ = ["display"]  # the fixture
FRAMES = 40
HOUR = 6      # times --seconds, which is ten minutes by default
LOOK = 5      # s between samples
HISTORY = 50  # frames: full within the first quarter of the shortest run
GROWTH = 1 << 20


@pytest.mark.parametrize(("option", "kept"), [("-history 5", 5), ("-memory 1M", 6)])
def test_the_oldest_frames_make_room(desk: Desk, display: Display, option: str, kept: int) -> None:
    window = Window(desk, display, *option.split())
    play(desk, make_clip(desk.folder / "clip.y4m", FRAMES))
    check(window.until(lambda seen: seen.number() == FRAMES - 1), FRAMES - 1, "LIVE", "STALLED")
    check(window.press("Home"), FRAMES - kept, "PAUSED")
    assert "this is the oldest frame" in window.press("comma").text
    window.close()
    assert result(window.process)[0] == 0


def anonymous(window: Window) -> int:
    """Bytes of the viewer's private memory, without mapped frames of the store."""
    found = re.search(r"RssAnon:\s+(\d+) kB", pathlib.Path(f"/proc/{window.process.pid}/status").read_text())
    assert found
    return int(found[1]) << 10


@pytest.mark.long
@pytest.mark.parametrize(("side", "mib"), [(4096, 64), (8192, 256)])
def test_memory_before_frames(tmp_path: pathlib.Path, display: Display, side: int, mib: int) -> None:
    """Two large frames fit, though 250 are allowed. The displayed frame is kept in addition, and its memory is reused
    for the next one."""
    frame, limit = side * side * 3 // 2, mib << 20
    with (tmp_path / "clip.y4m").open("wb") as file:
        file.write(b"YUV4MPEG2 W%d H%d F25:1 Ip A1:1 C420jpeg\n" % (side, side))
        for number in range(6):
            file.write(b"FRAME\n" + bytes([40 * number]) * frame)
    desk = Desk(tmp_path, f"{6 * mib}M")
    try:
        window = Window(desk, display, "-memory", f"{mib}M")
        play(desk, tmp_path / "clip.y4m")
        assert window.until(lambda seen: seen.frame() == 5).frame() == 5
        assert window.press("Home").frame() == 4
        assert anonymous(window) < limit + frame
        play(desk, tmp_path / "clip.y4m")
        assert "7 newer" in window.until(lambda seen: "7 newer" in seen.text).text
        assert anonymous(window) < limit + frame
        window.close()
        assert result(window.process)[0] == 0
    finally:
        desk.end()


@pytest.mark.long
def test_an_hour_without_growth(desk: Desk, display: Display, pytestconfig: pytest.Config,
                                record_property: Callable[[str, object], None]) -> None:
    """After the first quarter, memory and open files do not grow, and each sample shows newer frames. A file may be
    open briefly, so the least of a quarter counts."""
    window = Window(desk, display, "-history", HISTORY)
    clip = make_clip(desk.folder / "clip.y4m", FRAMES)
    source = desk.start("ddxvideoload", clip, "-loop")
    looks: list[tuple[int, int, int]] = []  # frame, bytes of memory, open files
    end = time.monotonic() + HOUR * int(pytestconfig.getoption("seconds"))
    while time.monotonic() < end:
        last = looks[-1][0] if looks else 0
        frame = window.until(lambda seen: (seen.frame() or 0) > last).frame() or 0
        assert frame > last
        looks.append((frame, anonymous(window), len(os.listdir(f"/proc/{window.process.pid}/fd"))))
        time.sleep(LOOK)
    quarter = len(looks) // 4
    record_property("frame, memory, files", [looks[quarter], looks[-1]])
    assert max(look[1] for look in looks[quarter:]) - looks[quarter][1] <= GROWTH
    assert min(look[2] for look in looks[-quarter:]) <= min(look[2] for look in looks[quarter:2 * quarter])
    source.terminate()
    window.close()
    assert result(window.process)[0] == 0
