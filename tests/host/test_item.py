# SPDX-License-Identifier: GPL-2.0-or-later
"""ddxvideo.h against a real store (item_client.c)."""
from __future__ import annotations

import pathlib

import pytest

from .programs import Compiler, Desk


@pytest.mark.parametrize("test", ["cif", "4k", "hostile", "paper_writer", "no_video", "parameters"])
def test_item(tmp_path: pathlib.Path, compile_client: Compiler, test: str) -> None:
    desk = Desk(tmp_path, memory="256M")
    try:
        result = desk.run(compile_client("item_client", "ddxvideo"), test)
        assert result.returncode == 0, result.stderr
    finally:
        desk.end()
