# SPDX-License-Identifier: GPL-2.0-or-later
"""A clip from a camera: pedestrians, from OpenCV's examples."""
import pathlib

from parts.common import run
from parts.media.examples import example


def footage(path: pathlib.Path, frames: int, size: str = "", crop: str = "") -> pathlib.Path:
    """Write the first frames as Y4M; its 10 frames a second become 25, and after 31 s it begins again. `size`: instead
    of 768x576. `crop`: only this part, in the form of FFmpeg's filter."""
    filters = ["setpts=N/25/TB", *([f"crop={crop}"] if crop else []), *([f"scale={size}"] if size else [])]
    run(["ffmpeg", "-v", "error", "-y", "-stream_loop", "-1", "-i", example("vtest.avi"), "-vf", ",".join(filters),
         "-r", "25", "-frames:v", str(frames), "-pix_fmt", "yuv420p", "-strict", "-1", path])
    return path
