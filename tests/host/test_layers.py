# SPDX-License-Identifier: GPL-2.0-or-later
"""Modules of tools and packages depend only on lower layers: no circles, and no part of the tools uses a command."""
import ast
import graphlib
import pathlib
import re

import pytest

from parts.common import TOP

pytestmark = pytest.mark.retry

PARTS = TOP / "tools/parts"
# Lowest first; modules in one line do not use each other.
LAYERS = [{"common"}, {"defects", "processes", "trees"}, {"image", "disk", "link"}, {"media"}, {"guest"},
          {"flash", "release", "testing"}]


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


# Folders of C sources, lowest first; folders in one line do not include each other.
FOLDERS = """
    ddx/include
    ddx/lib ddx/program ddxpanel/common
    ddx/form
    ddx/ddxctl ddx/store ddxcatalog/wire ddxlog/mcap ddxpanel/certificate ddxpanel/root ddxpanel/web
    ddxvideo/include
    ddxcatalog/ctl ddxcatalog/network ddxgrow ddxlog/log ddxlog/play ddxpanel ddxservice ddxupdate
    ddxvideo/common
    ddxvideo/coded ddxvideo/stream/core
    ddxcatalog/catalog ddxlog ddxvideo/draw ddxvideo/grab ddxvideo/save/pool ddxvideo/stream
    ddxcatalog ddxvideo/grab/iidc ddxvideo/grab/v4l ddxvideo/health ddxvideo/load ddxvideo/play ddxvideo/recordings
    ddxvideo/save ddxvideo/snap ddxvideo/stereo ddxvideo/stream/receive ddxvideo/stream/send
    ddxvideo/view
"""


def ups(top: pathlib.Path, table: str) -> list[str]:
    """Folders that are not in the table, or not there, and includes from a folder that is not below."""
    level = {f"package/{name}": number for number, line in enumerate(table.splitlines()) for name in line.split()}
    files = sorted(top.glob("package/**/*.[ch]"))
    homes: dict[str, set[str]] = {}
    for path in files:
        homes.setdefault(path.name, set()).add(str(path.parent.relative_to(top)))
    found = [f"{name}: not in one of the layers, or not there" for name in set().union(*homes.values()) ^ level.keys()]
    for path in files:
        mine = str(path.parent.relative_to(top))
        for name in re.findall(r'^ *# *include ["<](?:\.\.[\w./]*/)?(\w+\.h)[">]', path.read_text(), re.MULTILINE):
            home = homes.get(name, {mine})  # several: the build's include paths choose
            if mine not in home and all(level.get(one, 0) >= level.get(mine, 0) for one in home):
                found.append(f"{mine}/{path.name} includes {name}")
    return sorted(found)


def circles(top: pathlib.Path) -> list[str]:
    """Modules of one folder that include or call each other in a circle."""
    found = []
    for folder in sorted({path.parent for path in top.glob("package/**/*.[ch]")}):
        known = includes(folder)
        for name, others in calls(folder).items():
            known[name] |= others - {name}
        found += circle(known)
    return found


def test_c_folders_include_only_lower_folders() -> None:
    assert ups(TOP, FOLDERS) == []


def test_c_modules_form_no_circle() -> None:
    assert circles(TOP) == []


def write(top: pathlib.Path, files: dict[str, str]) -> None:
    for name, text in files.items():
        (top / "package" / name).parent.mkdir(parents=True, exist_ok=True)
        (top / "package" / name).write_text(text)


def test_an_include_upwards_is_found(tmp_path: pathlib.Path) -> None:
    table = "low\nsave/pool load\nsave"
    write(tmp_path, {"low/output.h": "", "save/pool/pool.c": '#include "pool.h"\n#include <output.h>\n',
                     "save/pool/pool.h": "", "save/output.h": "", "load/main.c": '#include "../low/output.h"\n',
                     "save/segment.h": "", "save/segment.c": '#include <stdio.h>\n#include "pool.h"\n'})
    assert ups(tmp_path, table) == []
    write(tmp_path, {"save/pool/pool.h": "#include <segment.h>\n", "load/main.c": '# include "../save/pool/pool.h"\n',
                     "stray/main.c": ""})
    assert ups(tmp_path, table) == ["package/load/main.c includes pool.h",
                                    "package/save/pool/pool.h includes segment.h",
                                    "package/stray: not in one of the layers, or not there"]


def test_a_circle_is_found(tmp_path: pathlib.Path) -> None:
    """Includes do not show calls between files whose functions are declared in one header."""
    write(tmp_path, {"one/low.h": "", "one/low.c": '#include "low.h"\n#include "../two/high.h"\n', "one/high.h": "",
                     "one/high.c": '#include "high.h"\n#include "low.h"\n',
                     "two/state.h": "int low(void);\nstruct state *high(int count);\n",
                     "two/low.c": '#include "state.h"\nint low(void) {\n    return 0;\n}\n',
                     "two/high.c": "static int own(void) {\n    return low();\n}\n"
                                   "struct state *high(int count) {\n    return count ? 0 : state(own);\n}\n"})
    assert circles(tmp_path) == []
    write(tmp_path, {"one/low.h": '#include "high.h"\n',
                     "two/low.c": "int low(void) {\n    /* low */ return *high(1);\n}\n"})
    assert circles(tmp_path) == ["circle: high low", "circle: high low"]
    write(tmp_path, {"one/low.h": "", "two/low.c": "int low(void) {\n    /* high() */ return start->high;\n}\n"})
    assert circles(tmp_path) == []


# The core of the stream works on bytes and times that its callers pass.
OUTSIDE = r"sys/socket|netinet|poll\.h|pthread|ddx_time_now|clock_gettime|<time\.h>|<unistd\.h>"


def test_the_core_of_the_stream_has_no_sockets_threads_or_clock() -> None:
    folder = TOP / "package/ddxvideo/stream/core"
    assert (folder / "stream_tx.h").exists() and (folder / "stream_rx.h").exists()
    assert [path.name for path in folder.glob("*.[ch]") if re.search(OUTSIDE, path.read_text())] == []
    assert re.search(OUTSIDE, (folder.parent / "send/post.c").read_text())


# Words that only one folder may use; others use that folder's header.
PRIVATE = {r"v4l2_|V4L2_|VIDIOC_|videodev2": "package/ddxvideo/grab/v4l",
           r"dc1394_|DC1394_|dc1394/": "package/ddxvideo/grab/iidc",
           r"mbedtls": "package/ddxpanel/certificate",
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
