# SPDX-License-Identifier: GPL-2.0-or-later
"""What the tools are made of looks downwards only: no circles, and no part knows a command."""
import ast
import pathlib

import pytest

from parts.common import TOP

PARTS = TOP / "tools/parts"
# From below; those of one line do not know each other.
LAYERS = [{"common"}, {"image", "disk"}, {"media"}, {"guest"}, {"bench", "flash", "release", "testing"}]


def topic(path: pathlib.Path) -> str:
    return path.stem if path.parent == PARTS else path.parent.name


def imported(path: pathlib.Path) -> set[str]:
    """Topics that this file imports from, and other modules of tools/."""
    names = []
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names += [f"parts.{a.name}" for a in node.names] if node.module == "parts" else [node.module]
    commands = {file.stem for file in (TOP / "tools").glob("*.py")}
    return {name.split(".")[1] for name in names if name.startswith("parts.")} | commands.intersection(names)


def wrong(path: pathlib.Path) -> set[str]:
    mine = topic(path)
    level = next(number for number, layer in enumerate(LAYERS) if mine in layer)
    return imported(path) - {mine}.union(*LAYERS[:level])


def test_downwards() -> None:
    files = set(PARTS.rglob("*.py")) - set(PARTS.rglob("__init__.py"))
    assert len(files) > 40
    assert {str(path.relative_to(TOP)): up for path in files if (up := wrong(path))} == {}


def test_upwards_is_found(tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(f"{__name__}.PARTS", tmp_path)
    (tmp_path / "media").mkdir()
    spoilt = tmp_path / "media/clip.py"
    spoilt.write_text("import build\nfrom parts.common import TOP\nfrom parts.guest.qemu import Guest\n"
                      "from parts import flash\n")
    assert wrong(spoilt) == {"build", "guest", "flash"}
