# SPDX-License-Identifier: GPL-2.0-or-later
"""What others wrote and the development image takes, made ready from Debian's packages: once on this machine, for all
clones.

It is in ~/.cache/ddxvideo/built, under names that change with all that it is made of: versions of the sources, our
choice of parts, the compiler.
"""
import pathlib
from collections.abc import Callable, Iterable

from archive import Archive
from common import CACHE, MACHINE, alone, fingerprint, run, step

COMPILER = ["gcc", "libc6-dev", "nasm", "zlib1g-dev"]


def _version(source: str) -> str:
    """Asked for once in a clone: it does not change while somebody works."""
    known = CACHE / f"{source}.version"
    if not known.exists():
        known.parent.mkdir(parents=True, exist_ok=True)
        known.write_text(Archive().version(source))
    return known.read_text()


def kept(name: str, key: str, make: Callable[[pathlib.Path], None]) -> pathlib.Path:
    """The folder that `make(folder)` filled, now or some time ago, with the same key."""
    tree = MACHINE / "built" / f"{name}-{key[:16]}"

    def anew() -> None:
        run(["rm", "-rf", tree])
        make(tree)

    with alone("build", MACHINE / "built" / f"{name}.lock"):
        step(name, tree.with_name(f"{tree.name}.stamp"), key, anew)
    return tree


def built(name: str, sources: Iterable[str], made_with: Iterable[pathlib.Path],
          build: Callable[[pathlib.Path, dict[str, pathlib.Path]], None]) -> pathlib.Path:
    """The install tree of what `build(tree, unpacked sources by name)` puts there; `made_with` are files of ours."""
    versions = {source: _version(source) for source in sources}
    compiler = run(["dpkg-query", "-W", "-f", "${Package} ${Version}\\n", *COMPILER])

    def make(tree: pathlib.Path) -> None:
        unpacked = {source: CACHE / source for source in versions}
        for source, folder in unpacked.items():
            Archive().source(source, folder)
        build(tree, unpacked)

    key = fingerprint([*made_with, pathlib.Path(__file__)], compiler, *map(" ".join, versions.items()))
    return kept(name, key, make)
