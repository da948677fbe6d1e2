# SPDX-License-Identifier: GPL-2.0-or-later
"""ddxvideocalib: an unusable clip is refused in one line, and no file is written."""
from __future__ import annotations

import importlib
import pathlib
import sys
from typing import Any

import numpy
import pytest

from parts.media import stereo_pairs

from .absent import module
from .programs import TOP
from .stereo_rules import found, write_clip

pytestmark = pytest.mark.retry

SIZE, FIELDS = "W64 H48", "XDDX_FIELDS=2"


@pytest.fixture
def calibrate(monkeypatch: pytest.MonkeyPatch, tmp_path: pathlib.Path) -> Any:
    module("cv2", "python3-opencv")
    monkeypatch.syspath_prepend(str(TOP / "package/ddxvideo/stereo"))
    monkeypatch.chdir(tmp_path)
    return importlib.import_module("calibrate")


def run(calibrate: Any, monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    monkeypatch.setattr(sys, "argv", ["ddxvideocalib", *arguments])
    return int(calibrate.main())


@pytest.mark.parametrize("header, text", [
    (None, "No such file or directory"),
    ("", "is no Y4M file of 8 bits"),
    ("YUV4MPEG2 W64 H48 C420p10", "is no Y4M file of 8 bits"),
    (f"YUV4MPEG2 {SIZE} Cmono16 {FIELDS}", "is no Y4M file of 8 bits"),
    (f"YUV4MPEG2 {SIZE} Cmono", "has 1 stacked fields, not two"),
    (f"YUV4MPEG2 W64 H49 Cmono {FIELDS}", "no picture is 64x49 with 2 fields"),
    (f"YUV4MPEG2 Wmany H48 Cmono {FIELDS}", "no picture is 0x48"),
    (f"YUV4MPEG2 Cmono {FIELDS}", "no picture is 0x0"),
    (f"YUV4MPEG2 W-64 H48 Cmono {FIELDS}", "no picture is 0x48"),
    (f"YUV4MPEG2 W99999999999 H48 Cmono {FIELDS}", "no picture is 0x48"),
    (f"YUV4MPEG2 {SIZE} Cmono XDDX_FIELDS=two", "no picture is 64x48 with 0 fields"),
    (f"YUV4MPEG2 {SIZE} Cmono {FIELDS}", "both eyes see the whole board in 0 pictures, and 4 are needed"),
])
def test_bad_clips(calibrate: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
                   header: str | None, text: str) -> None:
    clip = pathlib.Path("clip.y4m")
    if header is not None:
        clip.write_bytes(header.encode() + b"\n" + (b"FRAME\n" + bytes(64 * 48)) * 2)
    assert run(calibrate, monkeypatch, "clip.y4m") == 2
    said = capsys.readouterr()
    assert text in said.err and said.err.startswith("ddxvideocalib: ") and said.err.count("\n") == 1 and not said.out
    assert not pathlib.Path("stereo.yml").exists()


@pytest.mark.parametrize("option, value, text", [
    ("-board", "2x2", "inner corners"), ("-board", "9", "inner corners"), ("-square", "0", "a length above 0"),
    ("-square", "nan", "a length above 0"), ("-square", "wide", "a length above 0"), ("-most", "3", "at least 4")])
def test_bad_options(calibrate: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], option: str,
                     value: str, text: str) -> None:
    with pytest.raises(SystemExit) as left:
        run(calibrate, monkeypatch, "clip.y4m", option, value)
    assert left.value.code == 2 and text in capsys.readouterr().err


def test_two_clips_give_the_result_of_one(calibrate: Any, monkeypatch: pytest.MonkeyPatch,
                              capsys: pytest.CaptureFixture[str]) -> None:
    """The file is the same; swapped eyes and a picture's name without a format are refused."""
    boards = [found("chessboard", number) for number in stereo_pairs.CHESSBOARDS[:4]]
    write_clip(pathlib.Path("both.y4m"), [numpy.vstack(board) for board in boards])
    for eye, name in enumerate(["left.y4m", "right.y4m"]):
        write_clip(pathlib.Path(name), [board[eye] for board in boards], 1)
    assert run(calibrate, monkeypatch, "both.y4m", "-output", "one.yml") == 0
    assert run(calibrate, monkeypatch, "left.y4m", "right.y4m", "-output", "two.yml") == 0
    assert pathlib.Path("one.yml").read_text() == pathlib.Path("two.yml").read_text()
    assert run(calibrate, monkeypatch, "both.y4m", "-top", "right") == 2
    assert "the second eye is not to the right of the first" in capsys.readouterr().err
    assert run(calibrate, monkeypatch, "both.y4m", "-picture", "lines") == 2
    assert "lines: a name that ends in .png or .jpg is needed" in capsys.readouterr().err
