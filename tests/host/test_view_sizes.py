# SPDX-License-Identifier: GPL-2.0-or-later
"""ddxvideoview with each number of fields, and with the smallest and the largest pictures."""
import pathlib

import pytest

from lib.seen import Seen
from parts.media.display import Display

from .programs import Desk, result
from .test_view import HEIGHT, WIDTH, display, make_clip, middle
from .window import Window

pytestmark = pytest.mark.retry

__all__ = ["display"]  # the fixture
FRAMES, FIELDS, KEYS = 3, 16, 9
STEP = 50  # levels between frames
TOLERANCE = 4  # levels: scaling down is imprecise


def flat(path: pathlib.Path, side: int) -> pathlib.Path:
    """Write square frames of one grey level each."""
    with path.open("wb") as file:
        file.write(b"YUV4MPEG2 W%d H%d F25:1 Ip A1:1 C420jpeg XCOLORRANGE=FULL\n" % (side, side))
        for number in range(FRAMES):
            file.write(b"FRAME\n" + bytes([STEP * (number + 1)]) * side ** 2 + bytes([128]) * (side ** 2 // 2))
    return path


def paused(window: Window) -> None:
    while window.press("space").label != "PAUSED":
        pass


def numbers(seen: Seen, fields: int, columns: int) -> list[int | None]:
    """The numbers of all fields, in `columns` columns."""
    high, wide = seen.area.shape[:2]
    rows = -(-fields // columns)
    scale = min(wide / (columns * WIDTH), high / (rows * HEIGHT)) + 1e-6
    width, height = int(WIDTH * scale), int(HEIGHT * scale)
    left, top = (wide - columns * width) // 2, (high - rows * height) // 2
    return [seen.number(left + field % columns * width, top + field // columns * height, width, height)
            for field in range(fields)]


def long_but(values: list[int], short: int) -> list[object]:
    """Mark all values except one as long tests; the gate tries that one."""
    return [value if value == short else pytest.param(value, marks=pytest.mark.long) for value in values]


@pytest.mark.parametrize("fields", long_but(list(range(1, FIELDS + 1)), FIELDS))
def test_fields(desk: Desk, display: Display, fields: int) -> None:
    window = Window(desk, display, make_clip(desk.folder / "clip.y4m", FRAMES, fields))
    paused(window)
    seen = window.press("End")
    wanted = [FRAMES - 1 + 1000 * field for field in range(fields)]
    assert wanted in [numbers(seen, fields, columns) for columns in range(1, fields + 1)], seen.text
    for field in range(min(fields, KEYS)):
        seen = window.press(str(field + 1))
        assert seen.number(*middle(seen, 1)) == wanted[field], seen.text
    seen = window.press("0", "comma")
    assert (seen.frame(), seen.label) == (FRAMES - 2, "PAUSED")
    window.close()
    assert result(window.process)[0] == 0


@pytest.mark.parametrize("side", long_but([16, 8192], 16))
def test_sizes(desk: Desk, display: Display, side: int) -> None:
    window = Window(desk, display, flat(desk.folder / "clip.y4m", side))
    paused(window)
    for number, key in enumerate(["Home", "period", "period"]):
        seen = window.press(key)
        height, width = seen.area.shape[:2]
        assert seen.label == "PAUSED" and f"{number + 1}/{FRAMES}" in seen.text
        shown = seen.area[height // 2, width // 2].astype(int)
        assert (abs(shown - STEP * (number + 1)) <= TOLERANCE).all(), shown
    window.close()
    assert result(window.process)[0] == 0
