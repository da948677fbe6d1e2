# SPDX-License-Identifier: GPL-2.0-or-later
"""Two cameras: eyes_client.py LEFT RIGHT, the sizes of their pictures. For each line `ITEM MILLISECONDS VALUE` on
standard input, writes a picture of this value, which is also its frame number, captured that long after the start, and
answers the line."""
from __future__ import annotations

import sys

import ddx
import ddxvideo


def main() -> None:
    with ddx.Store() as store:
        items: dict[str, ddxvideo.VideoItem] = {}
        for name, size in zip(("left", "right"), sys.argv[1:]):
            width, height = map(int, size.split("x"))
            items[name] = ddxvideo.create_video(store, name, width, height, 25, layout="GREY8")
        begin = ddx.time_now()
        print("ready", flush=True)
        for line in sys.stdin:
            name, milliseconds, value = line.split()
            with items[name].loan() as out:
                out["time"] = begin + int(milliseconds) * 1000000
                out["frame"] = int(value)
                ddxvideo.planes(out)[0][:] = int(value)
            print("written", flush=True)


main()
