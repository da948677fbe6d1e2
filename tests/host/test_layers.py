# SPDX-License-Identifier: GPL-2.0-or-later
"""What tools, library and store are made of looks downwards only: no circles, and no tool's part knows a command."""
import ast
import graphlib
import pathlib
import re

import pytest

from parts.common import TOP

PARTS = TOP / "tools/parts"
# From below; those of one line do not know each other.
LAYERS = [{"common"}, {"defects", "trees"}, {"image", "disk", "link"}, {"media"}, {"guest"},
          {"bench", "flash", "release", "testing"}]

# The same for folders in C, but for their public headers; those of one line may know each other, not in a circle.
C_LAYERS = {
    "package/ddx/lib": [
        {"clock", "error", "expression", "fault", "hot"},
        {"layout", "type", "type_parse", "type_problem"},
        {"futex", "lock", "memory", "ring", "trust", "wire"},
        {"queue"},
        {"handle"},
        {"connection", "term", "window"},
        {"reader_role", "writer_readers", "writer_role"},
        {"reoffer"},
        {"receive"},
        {"reader", "reader_take", "writer"},
        {"direct"},
        {"info", "item", "keeper"},
        {"exchange", "request", "stats", "stats_book", "stats_histogram", "stats_json", "stats_takeover"},
        {"remote"},
    ],
    "package/ddx/store": [
        {"heap", "holder", "log"},
        {"checkpoint"},
        {"files", "listen"},
        {"state"},
        {"epoch", "items", "memfd_name", "link", "retired"},
        {"leftover"},
        {"budget", "descriptors", "notify", "process"},
        {"adopt", "claim", "readers"},
        {"request", "session"},
        {"resume", "worker"},
        {"main"},
    ],
}


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


def includes(folder: pathlib.Path) -> dict[str, set[str]]:
    """The modules of a folder, each a .c file, a .h file or both, and what others there each of them includes."""
    files = sorted(folder.glob("*.[ch]"))
    found: dict[str, set[str]] = {path.stem: set() for path in files}
    for path in files:
        names = set(re.findall(r'^ *# *include "(\w+)\.h"', path.read_text(), re.MULTILINE))
        found[path.stem] |= names & found.keys() - {path.stem}
    return found


def complaints(folder: pathlib.Path, layers: list[set[str]]) -> list[str]:
    modules = includes(folder)
    level = {name: number for number, layer in enumerate(layers) for name in layer}
    found = [f"{name}: not in one of the layers, or not there" for name in modules.keys() ^ level.keys()]
    found += [f"{name} includes {other}" for name, others in modules.items() for other in others
              if level.get(name, 0) < level.get(other, 0)]
    beside = {name: {other for other in others if level.get(name) == level.get(other)}
              for name, others in modules.items()}
    try:
        graphlib.TopologicalSorter(beside).prepare()
    except graphlib.CycleError as error:
        found.append("circle: " + " ".join(sorted(set(error.args[1]))))
    return sorted(found)


@pytest.mark.parametrize("folder", C_LAYERS)
def test_c_downwards(folder: str) -> None:
    assert complaints(TOP / folder, C_LAYERS[folder]) == []


def test_c_upwards_is_found(tmp_path: pathlib.Path) -> None:
    layers = [{"low", "below"}, {"middle"}, {"high", "beside"}]
    for name in ["low.h", "below.h", "middle.h", "high.h", "beside.h"]:
        (tmp_path / name).write_text("")
    (tmp_path / "middle.c").write_text('#include "middle.h"\n#include "low.h"\n#include "../far/high.h"\n')
    (tmp_path / "high.c").write_text('#include "high.h"\n#include "beside.h"\n')
    assert complaints(tmp_path, layers) == []
    (tmp_path / "low.c").write_text('#include <stdio.h>\n#include "middle.h"\n')
    (tmp_path / "beside.c").write_text('#include "high.h"\n')
    (tmp_path / "stray.h").write_text("")
    assert complaints(tmp_path, layers) == ["circle: beside high", "low includes middle",
                                            "stray: not in one of the layers, or not there"]


# What only one folder knows; others use that folder's header.
PRIVATE = {r"v4l2_|V4L2_|VIDIOC_|videodev2": "package/ddxvideo/grab/v4l",
           r"dc1394_|DC1394_|dc1394/": "package/ddxvideo/grab/iidc",
           r"\bdds_\w|\bddsi_|DDS_|<dds/": "package/ddxcatalog/network"}


def leaks(top: pathlib.Path, words: str, folder: str) -> list[str]:
    """C files and meson files of packages, outside the folder, that use one of the words."""
    return sorted(str(path.relative_to(top)) for kind in ["*.[ch]", "meson.build"]
                  for path in (top / "package").rglob(kind)
                  if not path.is_relative_to(top / folder) and re.search(words, path.read_text()))


@pytest.mark.parametrize("words, folder", PRIVATE.items())
def test_only_one_folder_knows(words: str, folder: str) -> None:
    assert any(re.search(words, path.read_text()) for path in (TOP / folder).glob("*.c"))
    assert leaks(TOP, words, folder) == []


def test_a_leak_is_found(tmp_path: pathlib.Path) -> None:
    for name, text in [("inside/camera.c", "struct v4l2_buffer buffer;"), ("grabber.h", "uint32_t v4l2_format;"),
                       ("grabber.c", "int v4l;")]:
        (tmp_path / "package" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "package" / name).write_text(text)
    assert leaks(tmp_path, "v4l2_|V4L2_", "package/inside") == ["package/grabber.h"]
