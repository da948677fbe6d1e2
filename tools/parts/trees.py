# SPDX-License-Identifier: GPL-2.0-or-later
"""The source trees of an image: ours, and those of EXTERNAL=path[:path], which have folders of the same names.

docs/programs.md describes such a tree. Trees with a package, a board or a configuration of the same name are refused.
"""
import os
import pathlib
import re
from collections.abc import Iterable

from parts.common import TOP, BadInput, output

BUILDROOT = TOP / "buildroot-external"  # our tree for Buildroot; in other trees this is the top
FOLDERS = ["package", "board", "configs", "overlay"]
FILES = ["external.desc", "external.mk", "Config.in"]  # of a tree for Buildroot
DEFCONFIG = re.compile(r"ddxvideo_(\w+)_defconfig")


def others() -> list[pathlib.Path]:
    """The trees of EXTERNAL; a relative path begins at the top of our tree, where make runs."""
    found = [(TOP / word).resolve() for word in os.environ.get("EXTERNAL", "").split(":") if word]
    for tree in found:
        if not any((tree / name).is_dir() for name in FOLDERS):
            raise BadInput(f"EXTERNAL: {tree} is " + (f"no tree: it has no folder {', '.join(FOLDERS[:-1])} or overlay"
                                                      if tree.is_dir() else "not there"))
    return found


def words() -> str:
    """EXTERNAL with absolute paths."""
    return ":".join(map(str, others()))


def serial() -> str:
    """The order of images: SERIAL, or the newest commit's time of all trees, in seconds since 1970; 0 outside git."""
    if given := os.environ.get("SERIAL"):
        if not given.isdecimal() or len(given) > 15:
            raise BadInput(f"SERIAL={given}: a number is needed, such as seconds since 1970")
        return given
    times = [output(["git", "-C", str(tree), "log", "-1", "--format=%ct"]).strip() for tree in [TOP, *others()]]
    return str(max((int(one) for one in times if one), default=0))


def oldest() -> str:
    """OLDEST: the serial of the oldest image that may replace this one; 0 if there is no limit."""
    given = os.environ.get("OLDEST") or "0"
    if not given.isdecimal() or int(given) > int(serial()):
        raise BadInput(f"OLDEST={given}: a serial that is at most the image's own, {serial()}")
    return given


def update_keys() -> list[pathlib.Path]:
    """UPDATE_KEYS: files with the public keys that an image trusts."""
    given = os.environ.get("UPDATE_KEYS", "").split()
    found = [(TOP / pathlib.Path(word).expanduser()).resolve() for word in given]
    for path in found:
        lines = path.read_text(errors="replace").splitlines() if path.is_file() else []
        # A secret key's second line begins in the same way, but is longer.
        if len(lines) != 2 or not re.fullmatch(r"RW[\w+/]{54}", lines[1]):
            raise BadInput(f"UPDATE_KEYS: {path} is no public key; `make update-key KEY=file` makes file.pub")
    if len({path.name for path in found}) != len(found):
        raise BadInput("UPDATE_KEYS: two keys have the same name")
    return found


def update_words(keys: list[pathlib.Path]) -> dict[str, str]:
    """For post-build.sh: what an image says about updates; it trusts these keys."""
    return {"DDX_SERIAL": serial(), "DDX_OLDEST": oldest(), "UPDATE_KEYS": " ".join(map(str, keys))}


def each(place: str) -> list[pathlib.Path]:
    """The file or folder of that name in each tree that has it, ours first."""
    return [tree / place for tree in [TOP, *others()] if (tree / place).exists()]


def _by_name(found: Iterable[tuple[str, pathlib.Path]]) -> dict[str, pathlib.Path]:
    result: dict[str, pathlib.Path] = {}
    for name, path in found:
        if name in result:
            raise BadInput(f"EXTERNAL: {path} has the name of {result[name]}; give it another one")
        result[name] = path
    return result


def packages() -> dict[str, pathlib.Path]:
    """The packages' folders, ours first."""
    return _by_name((path.name, path) for folder in each("package") for path in sorted(folder.iterdir())
                    if path.is_dir())


def foreign() -> dict[str, pathlib.Path]:
    """The packages of the other trees."""
    return {name: path for name, path in packages().items() if path.parent != TOP / "package"}


def boards() -> dict[str, pathlib.Path]:
    """The boards' folders."""
    found = [path.parent for folder in each("board") for path in sorted(folder.glob("*/meta"))]
    return _by_name((path.name, path) for path in found)


def buildroot() -> dict[str, pathlib.Path]:
    """Buildroot's BR2_EXTERNAL trees by their names there, as in BR2_EXTERNAL_<name>_PATH."""
    found = []
    for tree in [BUILDROOT, *others()]:
        if missing := [name for name in FILES if not (tree / name).is_file()]:
            raise BadInput(f"EXTERNAL: {tree} has no {', '.join(missing)}, which Buildroot needs")
        name = re.search(r"^name:\s*(\w+)\s*$", (tree / FILES[0]).read_text(), re.M)
        if not name:
            raise BadInput(f"EXTERNAL: {tree / FILES[0]} has no line `name: NAME`")
        found.append((name[1], tree))
    return _by_name(found)


def defconfigs() -> dict[str, pathlib.Path]:
    """The boards that Buildroot builds, and their configurations."""
    files = [path for tree in [BUILDROOT, *others()] for path in sorted((tree / "configs").glob("*"))]
    return _by_name((name[1], path) for path in files if (name := DEFCONFIG.fullmatch(path.name)))


def sources(board: str) -> list[pathlib.Path]:
    """All sources of a board's image."""
    mine = [tree / name for tree in others() for name in ["configs", *FILES]]
    return [*each("package"), *each("overlay"), *each("board/common"), *each(f"board/{board}"), BUILDROOT,
            *(path for path in mine if path.exists())]


def local_packages(folders: Iterable[pathlib.Path] | None = None) -> dict[str, list[str]]:
    """Packages whose source is in a tree: each with its dependencies among them, itself included."""
    texts = {path.parent.name: path.read_text() for folder in folders or packages().values()
             for path in sorted(folder.glob("*.mk"))}
    local = {name: text for name, text in texts.items() if "_SITE_METHOD = local" in text}
    needs = {name: set(" ".join(re.findall(r"_DEPENDENCIES \+?= (.*)", text)).split()) & set(local)
             for name, text in local.items()}
    result: dict[str, list[str]] = {}
    for name in local:
        whole, wanted = {name}, set(needs[name])
        while wanted - whole:
            whole |= wanted
            wanted = {one for other in whole for one in needs[other]}
        result[name] = sorted(whole)
    return result
