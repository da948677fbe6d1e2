# SPDX-License-Identifier: GPL-2.0-or-later
"""Our programs in Rust, for measurements and tests alone."""
import pathlib
import re
import shutil
import tempfile

from parts.common import Failed, fingerprint, run
from parts.image import foreign


def project(source: pathlib.Path, copy: pathlib.Path) -> pathlib.Path:
    """A copy of a folder. Its lock file pins versions and checksums, but not where packages come from."""
    shutil.copytree(source, copy, dirs_exist_ok=True)
    lock = copy / "Cargo.lock"
    pinned = lock.read_text()
    lock.unlink()
    run(["cargo", "generate-lockfile"], cwd=copy)
    registry = re.search(r'^source = "(registry\+[^"]+)"$', lock.read_text(), re.M)
    if not registry:
        raise Failed("cargo names no registry")
    lock.write_text(pinned.replace('source = "registry"', f'source = "{registry[1]}"'))
    return copy


def program(source: pathlib.Path) -> pathlib.Path:
    """The program of a folder, which has its name. The network is needed the first time only."""
    if not shutil.which("cargo"):
        raise Failed("cargo is not installed")

    def make(tree: pathlib.Path) -> None:
        with tempfile.TemporaryDirectory() as name:
            folder = pathlib.Path(name)
            run(["cargo", "build", "--release", "--locked", "--target-dir", folder / "target"],
                cwd=project(source, folder / "project"))
            tree.mkdir(parents=True)
            shutil.copy(folder / "target/release" / source.name, tree)

    key = fingerprint([source, pathlib.Path(__file__)], run(["cargo", "--version"]))
    return foreign.kept(source.name, key, make) / source.name
