# SPDX-License-Identifier: GPL-2.0-or-later
"""Software of others, made ready for the development image or the tests: once on this machine, for all clones.

It is in ~/.cache/ddxvideo/built, under names that change with all that it is made of: versions of the sources, our
choice of parts, the compiler. It may be deleted at any time.
"""
import pathlib
from collections.abc import Callable, Iterable

from parts.common import CACHE, HOST_CACHE, alone, fingerprint, run, step
from parts.image.archive import Archive

COMPILER = ["gcc", "libc6-dev", "nasm", "zlib1g-dev"]


def asked(name: str, ask: Callable[[], str]) -> str:
    """The archive's answer, asked for once in a clone: it does not change during the work."""
    known = CACHE / name
    if not known.exists():
        known.parent.mkdir(parents=True, exist_ok=True)
        known.write_text(ask())
    return known.read_text()


def kept(name: str, key: str, make: Callable[[pathlib.Path], None]) -> pathlib.Path:
    """The folder that `make(folder)` filled, now or some time ago, with the same key."""
    tree = HOST_CACHE / "built" / f"{name}-{key[:16]}"

    def rebuild() -> None:
        run(["rm", "-rf", tree])
        make(tree)

    with alone("build", HOST_CACHE / "built" / f"{name}.lock"):
        step(name, tree.with_name(f"{tree.name}.stamp"), key, rebuild)
    return tree


def built(name: str, sources: Iterable[str], made_with: Iterable[pathlib.Path],
          build: Callable[[pathlib.Path, dict[str, pathlib.Path]], None]) -> pathlib.Path:
    """The install tree of what `build(tree, unpacked sources by name)` puts there; `made_with` are files of ours."""
    archive = Archive()
    versions = {source: asked(f"{source}.version", lambda: archive.version(source)) for source in sources}
    compiler = run(["dpkg-query", "-W", "-f", "${Package} ${Version}\\n", *COMPILER])

    def make(tree: pathlib.Path) -> None:
        place = CACHE / "unpacked" / name
        unpacked = {source: place / source for source in versions}
        for source, folder in unpacked.items():
            archive.source(source, folder)
        build(tree, unpacked)
        run(["rm", "-rf", place])

    key = fingerprint([*made_with, pathlib.Path(__file__)], compiler, *map(" ".join, versions.items()))
    return kept(name, key, make)
