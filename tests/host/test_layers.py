# SPDX-License-Identifier: GPL-2.0-or-later
"""Modules of tools and packages depend only on lower layers: no circles, and no part of the tools uses a command."""
import ast
import graphlib
import pathlib
import re

import pytest

from parts.common import TOP

from .layers import TABLES, layers

PARTS = TOP / "tools/parts"
# Lowest first; modules in one line do not use each other.
LAYERS = [{"common"}, {"defects", "processes", "trees"}, {"image", "disk", "link"}, {"media"}, {"guest"},
          {"bench", "flash", "release", "testing"}]


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


def test_tools_import_only_lower_layers() -> None:
    files = set(PARTS.rglob("*.py")) - set(PARTS.rglob("__init__.py"))
    assert len(files) > 40
    assert {str(path.relative_to(TOP)): up for path in files if (up := wrong(path))} == {}


def test_an_import_upwards_is_found(tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(f"{__name__}.PARTS", tmp_path)
    (tmp_path / "media").mkdir()
    spoilt = tmp_path / "media/clip.py"
    spoilt.write_text("import build\nfrom parts.common import TOP\nfrom parts.guest.qemu import Guest\n"
                      "from parts import flash\n")
    assert wrong(spoilt) == {"build", "guest", "flash"}


def bare(path: pathlib.Path) -> str:
    """A source without comments and strings."""
    return re.sub(r'/\*.*?\*/|"(?:\\.|[^"\\\n])*"', "", path.read_text(), flags=re.DOTALL)


def defined(text: str) -> set[str]:
    """The functions of a file that other files can call."""
    return set(re.findall(r"^(?!static\b)\w[\w *]*?\b(\w+)\([^;{}]*\) ?\{", text, re.MULTILINE))


def calls(folder: pathlib.Path) -> dict[str, set[str]]:
    """The modules of a folder, and the modules whose functions each of them calls or passes on."""
    texts = {path.stem: bare(path) for path in folder.glob("*.c")}
    owners: dict[str, set[str]] = {}
    for name, text in texts.items():
        for function in defined(text):
            owners.setdefault(function, set()).add(name)
    used = {name: set(re.findall(r"(?<![.>])\b[a-z]\w+", text)) & owners.keys() for name, text in texts.items()}
    return {name: {owner for function in functions if name not in owners[function] for owner in owners[function]}
            for name, functions in used.items()}


def includes(folder: pathlib.Path) -> dict[str, set[str]]:
    """The modules of a folder (a .c file, a .h file or both), and the modules there that each of them includes."""
    files = sorted(folder.glob("*.[ch]"))
    found: dict[str, set[str]] = {path.stem: set() for path in files}
    for path in files:
        names = set(re.findall(r'^ *# *include "(\w+)\.h"', path.read_text(), re.MULTILINE))
        found[path.stem] |= names & found.keys() - {path.stem}
    return found


def circle(known: dict[str, set[str]]) -> list[str]:
    try:
        graphlib.TopologicalSorter(known).prepare()
    except graphlib.CycleError as error:
        return ["circle: " + " ".join(sorted(set(error.args[1])))]
    return []


def complaints(folder: pathlib.Path, table: list[set[str]]) -> list[str]:
    called, included = calls(folder), includes(folder)
    level = {name: number for number, layer in enumerate(table) for name in layer}
    found = [f"{name}: not in one of the layers, or not there" for name in included.keys() ^ level.keys()]
    for verb, known in [("includes", included), ("calls", called)]:
        found += [f"{name} {verb} {other}" for name, others in known.items() for other in others
                  if level.get(name, 0) < level.get(other, 0)]
    beside = {name: {other for other in included[name] | called.get(name, set()) if level.get(name) == level.get(other)}
              for name in included}
    return sorted(found + circle(beside))


def c_folders(top: pathlib.Path) -> list[str]:
    """Folders of several modules, where circles are possible."""
    folders = sorted({path.parent for path in top.glob("package/**/*.[ch]")})
    return [str(folder.relative_to(top)) for folder in folders if len(includes(folder)) > 1]


def test_each_folder_has_its_layers() -> None:
    assert c_folders(TOP) == sorted(TABLES)


@pytest.mark.parametrize("folder", TABLES)
def test_c_modules_use_only_lower_layers(folder: str) -> None:
    assert complaints(TOP / folder, layers(folder)) == []


def test_an_include_upwards_is_found(tmp_path: pathlib.Path) -> None:
    table = [{"low", "below"}, {"middle"}, {"high", "beside"}]
    for name in ["low.h", "below.h", "middle.h", "high.h", "beside.h"]:
        (tmp_path / name).write_text("")
    (tmp_path / "middle.c").write_text('#include "middle.h"\n#include "low.h"\n#include "../far/high.h"\n')
    (tmp_path / "high.c").write_text('#include "high.h"\n#include "beside.h"\n')
    assert complaints(tmp_path, table) == []
    (tmp_path / "low.c").write_text('#include <stdio.h>\n#include "middle.h"\n')
    (tmp_path / "beside.c").write_text('#include "high.h"\n')
    (tmp_path / "stray.h").write_text("")
    assert complaints(tmp_path, table) == ["circle: beside high", "low includes middle",
                                           "stray: not in one of the layers, or not there"]


def test_a_call_upwards_is_found(tmp_path: pathlib.Path) -> None:
    """Includes do not show calls between files whose functions are declared in one header."""
    (tmp_path / "state.h").write_text("int low(void);\nstruct state *high(int count);\nint right(void);\n")
    (tmp_path / "low.c").write_text('#include "state.h"\nint low(void) {\n    return 0;\n}\n')
    (tmp_path / "high.c").write_text('#include "state.h"\nstatic int own(void) {\n    return low();\n}\n'
                                     "struct state *high(int count) {\n    return count ? 0 : state(own);\n}\n")
    (tmp_path / "right.c").write_text("int right(void) {\n    return 0;\n}\n")
    table = [{"state"}, {"low"}, {"high", "right"}]
    assert complaints(tmp_path, table) == []
    (tmp_path / "low.c").write_text("int low(void) {\n    /* right */ return start->right + start(high);\n}\n")
    (tmp_path / "right.c").write_text("int right(void) {\n    return *high(1);\n}\n")
    assert complaints(tmp_path, table) == ["low calls high"]
    (tmp_path / "high.c").write_text("struct state *high(int count) {\n    return right();\n}\n")
    assert complaints(tmp_path, table) == ["circle: high right", "low calls high"]


def between(top: pathlib.Path) -> dict[str, set[str]]:
    """The folders from which each folder includes; names of headers in several folders are ignored."""
    files = sorted(top.glob("package/**/*.[ch]"))
    homes: dict[str, set[pathlib.Path]] = {}
    for path in files:
        homes.setdefault(path.name, set()).add(path.parent)
    found: dict[str, set[str]] = {}
    for path in files:
        for name in re.findall(r'^ *# *include ["<](\w+\.h)[">]', path.read_text(), re.MULTILINE):
            home = homes.get(name, set())
            if len(home) == 1 and path.parent not in home:
                found.setdefault(str(path.parent.relative_to(top)), set()).add(str(min(home).relative_to(top)))
    return found


def test_folders_include_each_other_in_one_direction() -> None:
    known = between(TOP)
    assert "package/ddxvideo/save/pool" in known["package/ddxvideo/save"]
    assert circle(known) == []


def test_a_circle_of_folders_is_found(tmp_path: pathlib.Path) -> None:
    for name, text in [("save/pool/pool.h", ""), ("save/pool/pool.c", '#include "pool.h"\n'), ("save/segment.h", ""),
                       ("save/segment.c", '#include "pool.h"\n#include <stdio.h>\n')]:
        (tmp_path / "package" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "package" / name).write_text(text)
    assert circle(between(tmp_path)) == []
    (tmp_path / "package/save/pool/pool.h").write_text("#include <segment.h>\n")
    assert circle(between(tmp_path)) == ["circle: package/save package/save/pool"]


# Words that only one folder may use; others use that folder's header.
PRIVATE = {r"v4l2_|V4L2_|VIDIOC_|videodev2": "package/ddxvideo/grab/v4l",
           r"dc1394_|DC1394_|dc1394/": "package/ddxvideo/grab/iidc",
           r"\bdds_\w|\bddsi_|DDS_|<dds/": "package/ddxcatalog/network"}


def leaks(top: pathlib.Path, words: str, folder: str) -> list[str]:
    """C files and meson files of packages, outside the folder, that use one of the words."""
    return sorted(str(path.relative_to(top)) for kind in ["*.[ch]", "meson.build"]
                  for path in (top / "package").rglob(kind)
                  if not path.is_relative_to(top / folder) and re.search(words, path.read_text()))


@pytest.mark.parametrize("words, folder", PRIVATE.items())
def test_only_one_folder_uses(words: str, folder: str) -> None:
    assert any(re.search(words, path.read_text()) for path in (TOP / folder).glob("*.c"))
    assert leaks(TOP, words, folder) == []


def test_a_leak_is_found(tmp_path: pathlib.Path) -> None:
    for name, text in [("inside/camera.c", "struct v4l2_buffer buffer;"), ("grabber.h", "uint32_t v4l2_format;"),
                       ("grabber.c", "int v4l;")]:
        (tmp_path / "package" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "package" / name).write_text(text)
    assert leaks(tmp_path, "v4l2_|V4L2_", "package/inside") == ["package/grabber.h"]
