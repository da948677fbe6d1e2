# SPDX-License-Identifier: GPL-2.0-or-later
"""BusyBox from Debian's source package, built with the product's configuration."""
import os
import pathlib

from archive import Archive
from common import CACHE, OUTPUT, TOP, fingerprint, run, step

CONFIG = TOP / "board/common/busybox.config"


def busybox() -> pathlib.Path:
    """An install tree: bin/busybox and its links."""
    out = OUTPUT / "dev/busybox"
    source = CACHE / "busybox"

    def unpack() -> None:
        Archive().source("busybox", source)

    def build() -> None:
        (source / ".config").write_text(CONFIG.read_text())
        run(["sh", "-c", 'yes "" | make oldconfig'], cwd=source)
        run(["make", f"-j{os.cpu_count()}", "busybox"], cwd=source)
        run(["rm", "-rf", out])
        run(["make", f"CONFIG_PREFIX={out}", "install"], cwd=source)

    step("BusyBox: source", CACHE / "busybox.stamp", "bookworm", unpack)
    step("BusyBox: build", OUTPUT / "dev/busybox.stamp", fingerprint([CONFIG, pathlib.Path(__file__)]), build)
    return out
