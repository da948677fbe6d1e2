# SPDX-License-Identifier: GPL-2.0-or-later
"""Our programs in Rust, for measurements alone."""
import pathlib
import re
import shutil

from parts.common import Failed, run


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
