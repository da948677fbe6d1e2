# SPDX-License-Identifier: GPL-2.0-or-later
"""The extra disk of a test: a clip, and settings for the services. The image itself contains no tests."""
import os
import pathlib
import shutil
from collections.abc import Mapping

from parts.common import run, scratch
from parts.media import y4m

Files = Mapping[str, pathlib.Path | str]
FRAMES = 32  # of the clip that fit into the store
USUAL = 32   # MiB of the store in the image: package/ddx/store/store.default


def _budget(clip: pathlib.Path) -> int:
    """MiB of the store for the clip."""
    header, _ = y4m.read(clip)
    return max(USUAL, -(-header.width * header.height * 3 // 2 * FRAMES // 2**20))


def more_memory(clip: pathlib.Path) -> int:
    """MiB of RAM that a guest needs for the clip in addition to its machine's."""
    return 2 * (_budget(clip) - USUAL)


def fill(folder: pathlib.Path, clip: pathlib.Path | None, files: Files | None = None) -> None:
    """Fill a test disk: a clip that the image replays when it starts, and other files by name, each as a path or a
    text, such as a service's settings."""
    content: dict[str, pathlib.Path | str] = {"clip.y4m": clip} if clip else {}
    content.update(files or {})
    if clip and _budget(clip) > USUAL:
        content["ddxstore.conf"] = f"m={_budget(clip)}M\n"
    for where, source in content.items():
        if isinstance(source, str):
            (folder / where).write_text(source)
            continue
        try:
            os.link(source, folder / where)
        except OSError:
            shutil.copy(source, folder / where)


def make(disk: pathlib.Path, clip: pathlib.Path | None, files: Files | None = None) -> pathlib.Path:
    """Make a test disk, see fill()."""
    with scratch() as folder:
        fill(folder, clip, files)
        bytes_used = sum(path.stat().st_size for path in folder.iterdir())
        size = bytes_used // 1024 + bytes_used // 50_000 + 8192
        disk.unlink(missing_ok=True)
        run(["mke2fs", "-q", "-t", "ext4", "-O", "^has_journal", "-L", "DDXTEST", "-m", "0",
             "-i", "65536",  # bytes for each inode; the usual 4096 of a small disk would take a sixteenth of it
             "-d", folder, disk, f"{size}k"])
    return disk
