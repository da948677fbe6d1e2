# SPDX-License-Identifier: GPL-2.0-or-later
"""BusyBox from Debian's source package, built with the product's configuration."""
import os
import pathlib

from parts.common import TOP, run
from parts.image import foreign

CONFIG = TOP / "board/common/busybox.config"


def build(tree: pathlib.Path, sources: dict[str, pathlib.Path]) -> None:
    source = sources["busybox"]
    (source / ".config").write_text(CONFIG.read_text())
    run(["sh", "-c", 'yes "" | make oldconfig'], cwd=source)
    run(["make", f"-j{os.cpu_count()}", "busybox"], cwd=source)
    run(["make", f"CONFIG_PREFIX={tree}", "install"], cwd=source)


def busybox() -> pathlib.Path:
    """An install tree: bin/busybox and its links."""
    return foreign.built("BusyBox", ["busybox"], [CONFIG, pathlib.Path(__file__)], build)
