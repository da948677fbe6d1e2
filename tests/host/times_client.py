#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""times_client.py ITEM WIDTH HEIGHT LAYOUT RATE TIME...: writes a frame of noise with each of these capture times, ns,
into a new video item."""
import sys

import numpy as np

import ddx  # found by PYTHONPATH
import ddxvideo


def main() -> None:
    name, width, height, layout, rate, *times = sys.argv[1:]
    noise = np.random.default_rng(1)
    with ddx.Store() as store, ddxvideo.create_video(store, name, int(width), int(height), float(rate),
                                                     layout=layout) as item:
        for number, capture in enumerate(map(int, times)):
            with item.loan() as frame:
                for plane in ddxvideo.planes(frame):
                    plane[...] = noise.integers(0, 256, plane.shape, plane.dtype)
                frame["frame"], frame["time"], frame["wall_offset"] = number, capture, 1_000_000
                frame["source_sequence"] = number * 2


if __name__ == "__main__":
    main()
