# SPDX-License-Identifier: GPL-2.0-or-later
"""A client in the paper's form compiles without warnings and gets the right pixels."""
from __future__ import annotations

import itertools
import pathlib
import subprocess

import pytest

from .programs import ROOT, Compiler, Desk, make_clip, pictures, start_recorder, stop, times

pytestmark = pytest.mark.strict


def plane_sum(plane: bytes) -> int:
    result = 0
    for sample in plane:
        result = (result * 31 + sample) & 0xffffffff
    return result


def test_paper_client(desk: Desk, compile_client: Compiler) -> None:
    program = compile_client("paper_client")
    clip = make_clip(desk.folder / "clip.y4m", "352x288", "20", 20)
    client = desk.start(program, 10)
    loader = desk.run("ddxvideoload", clip, "-readers", "1")
    assert loader.returncode == 0
    out, _ = client.communicate(timeout=60)
    assert client.returncode == 0, desk.errors(client)
    lines = [line.split() for line in out.splitlines()]
    assert [line[0] for line in lines] == ["live", "copy"] * 5
    luma = 352 * 288
    for how, frame, fields, size, *sums in lines:
        picture = pictures(clip)[int(frame)]
        planes = picture[:luma], picture[luma:luma * 5 // 4], picture[luma * 5 // 4:]
        assert (fields, size) == ("1", "352x288")
        assert [int(value) for value in sums] == [plane_sum(plane) for plane in planes], (how, frame)
    numbers = [int(line[1]) for line in lines]
    assert numbers == sorted(set(numbers))


def test_a_picture_larger_than_the_client_s_struct(desk: Desk, compile_client: Compiler) -> None:
    """The frame is refused, not truncated or torn."""
    program = compile_client("paper_client")
    clip = make_clip(desk.folder / "clip.y4m", "1280x720", "20", 10)
    client = desk.start(program, 1)
    loader = desk.start("ddxvideoload", clip, "-loop")
    assert client.wait(60) == 1
    loader.terminate()


def test_grabber_of_the_papers_kind(desk: Desk, compile_client: Compiler) -> None:
    """An item with only the seven fields is recorded, with the times of its writes."""
    saver = start_recorder(desk, "-output", "out.y4m")
    assert desk.run(compile_client("item_client", "ddxvideo"), "paper_grabber").returncode == 0
    status, counters = stop(saver)
    assert status == 0 and counters["out"] == 20
    sizes = {"y": 80 * 60, "u": 40 * 30, "v": 40 * 30}
    expected = [b"".join(bytes([number + i]) * size for i, size in enumerate(sizes.values())) for number in range(20)]
    assert pictures(desk.folder / "out.y4m") == expected
    steps = [b - a for a, b in itertools.pairwise(times(desk.folder / "out.y4m"))]
    assert min(steps) >= 10_000_000


def test_the_headers_are_strict_c_and_c_plus_plus(tmp_path: pathlib.Path) -> None:
    """The headers alone compile as C and C++ with all warnings."""
    for compiler, standard, suffix in (("gcc", "gnu11", "c"), ("g++", "gnu++17", "cc")):
        source = tmp_path / f"header.{suffix}"
        source.write_text("#include <ddxvideo.h>\n#include <ddx_stats.h>\nint main() { return 0; }\n")
        subprocess.run([compiler, f"-std={standard}", "-Wall", "-Wextra", "-Werror", "-Wconversion", "-Wshadow",
                        f"-I{ROOT}/include", "-c", source, "-o", tmp_path / "header.o"], check=True)
