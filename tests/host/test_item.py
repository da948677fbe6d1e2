# SPDX-License-Identifier: GPL-2.0-or-later
"""ddxvideo.h with a real store (item_client.c)."""
from __future__ import annotations

import json
import pathlib

import pytest

from .programs import Compiler, Desk, make_clip, stop, wait_until

pytestmark = pytest.mark.retry


@pytest.mark.parametrize("test", ["cif", "4k", "hostile", "layouts", "false_formats", "paper_writer", "no_video",
                                  "parameters"])
def test_item(tmp_path: pathlib.Path, compile_client: Compiler, test: str) -> None:
    desk = Desk(tmp_path, memory="256M")
    try:
        result = desk.run(compile_client("item_client", "ddxvideo"), test)
        assert result.returncode == 0, result.stderr
    finally:
        desk.end()


def test_a_replay_shows_its_parameters(desk: Desk) -> None:
    loader = desk.start("ddxvideoload", make_clip(desk.folder / "clip.y4m", frames=5), "-loop", "-rate", "2.5")
    wait_until(lambda: desk.run("ddxctl", "show", "video.parameters").returncode == 0)
    shown = json.loads(desk.run("ddxctl", "show", "video.parameters", "--json").stdout)["value"]
    values = {entry["name"]: entry["value"] for entry in shown["parameter"][:shown["count"]]}
    assert values == {"rate_permille": 2500, "loop": 1, "readers": 0}
    assert stop(loader)[0] == 0
