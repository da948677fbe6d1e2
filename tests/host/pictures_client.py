# SPDX-License-Identifier: GPL-2.0-or-later
"""pictures_client.py ITEM LAYOUT [WIDTH HEIGHT]: for each number on standard input, writes a picture (default: CIF) and
answers with the SHA-256 that ROS must get."""
from __future__ import annotations

import hashlib
import sys
from typing import Any

import numpy as np

import ddx
import ddxvideo


def rgb(y: Any, u: Any, v: Any) -> Any:
    """Convert planes in limited range by ITU-R BT.601."""
    luma = 298 * (y.astype(int) - 16)
    u, v = (np.repeat(np.repeat(plane.astype(int) - 128, 2, 0), 2, 1) for plane in (u, v))
    colours = np.stack([luma + 409 * v, luma - 100 * u - 208 * v, luma + 516 * u], axis=-1)
    return np.clip((colours + 128) >> 8, 0, 255).astype(np.uint8)


def main() -> None:
    name, layout, *sides = sys.argv[1:]
    width, height = map(int, sides or (352, 288))
    with ddx.Store(timeout=20) as store, ddxvideo.create_video(store, name, width, height, 25, layout=layout) as item:
        for line in sys.stdin:
            random = np.random.default_rng(int(line))
            with item.loan() as out:
                planes = ddxvideo.planes(out)
                for plane in planes:
                    plane[:] = random.integers(0, 256, plane.shape)
                seen = rgb(*planes) if layout == "YUV420P" else planes[0]
                digest = hashlib.sha256(seen.tobytes()).hexdigest()
            print(digest, flush=True)


main()
