# SPDX-License-Identifier: GPL-2.0-or-later
"""Moving pictures that a camera made: pedestrians, from OpenCV's examples in Debian."""
import pathlib

from parts.common import CACHE, run
from parts.image.archive import Archive

PATH = "./usr/share/doc/opencv-doc/examples/data/vtest.avi"


def footage(path: pathlib.Path, frames: int, size: str = "", crop: str = "") -> pathlib.Path:
    """The first frames as Y4M; its 10 frames a second are played at the pace of PAL. `size`: other than its 768x576.
    `crop`: only this part, as FFmpeg's filter of that name describes it."""
    avi = CACHE / "vtest.avi"
    if not avi.exists():
        package = Archive().package("opencv-doc")
        avi.parent.mkdir(parents=True, exist_ok=True)
        unpack = f'dpkg-deb --fsys-tarfile "$1" | tar -xO {PATH} > "$2.new" && mv "$2.new" "$2"'
        run(["sh", "-c", unpack, "sh", package, avi])
        package.unlink()
    filters = ["setpts=N/25/TB", *([f"crop={crop}"] if crop else []), *([f"scale={size}"] if size else [])]
    run(["ffmpeg", "-v", "error", "-y", "-i", avi, "-vf", ",".join(filters), "-r", "25", "-frames:v", str(frames),
         "-pix_fmt", "yuv420p", "-strict", "-1", path])
    return path
