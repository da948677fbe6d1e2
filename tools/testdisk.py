# SPDX-License-Identifier: GPL-2.0-or-later
"""The extra disk of a test: a clip, and settings for the services. The image itself knows nothing of tests."""
import os
import pathlib
import shutil
import tempfile

import y4m
from common import run

FRAMES = 32  # room in the store for that many frames of the clip
USUAL = 32   # MiB; what the image gives the store: package/ddx/store/store.default


def _budget(clip: pathlib.Path) -> int:
    """MiB that the store needs for the clip."""
    header, _ = y4m.read(clip)
    return max(USUAL, -(-header.width * header.height * 3 // 2 * FRAMES // 2**20))


def memory(clip: pathlib.Path) -> int:
    """MiB of RAM that a guest needs for the clip."""
    return 376 + 2 * _budget(clip)


def make(disk: pathlib.Path, clip: pathlib.Path) -> pathlib.Path:
    with tempfile.TemporaryDirectory(prefix="ddx-") as name:
        folder = pathlib.Path(name)
        try:
            os.link(clip, folder / "clip.y4m")
        except OSError:
            shutil.copy(clip, folder / "clip.y4m")
        if _budget(clip) > USUAL:
            (folder / "store.conf").write_text(f"m={_budget(clip)}M\n")
        size = clip.stat().st_size // 1024 + clip.stat().st_size // 50_000 + 8192
        disk.unlink(missing_ok=True)
        run(["mke2fs", "-q", "-t", "ext4", "-O", "^has_journal", "-L", "DDXTEST", "-m", "0", "-d", folder,
             disk, f"{size}k"])
    return disk
