#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""numbers_client.py ITEM: prints `ready`, then for each frame of an item of CIF pictures its writer's number and the
number in its picture (- if unreadable). Stops at SIGTERM."""
import contextlib
import signal
import sys

import ddx  # found by PYTHONPATH

from parts.media.clip import HEIGHT, WIDTH, frame_number

KEEP = 64  # frames: a stream that restores a packet shows all waiting frames at once


def main() -> None:
    stopped: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, _: stopped.append(number))
    with ddx.Store() as store, store.item(sys.argv[1], awaited=True) as item:
        item.keep(KEEP)
        print("ready", flush=True)
        while not stopped:
            with contextlib.suppress(TimeoutError), item.acquire(0.2, ddx.IN_ORDER) as frame:
                number = frame_number(frame["y"].tobytes(), WIDTH, HEIGHT)
                print(frame["frame"], "-" if number is None else number, flush=True)


if __name__ == "__main__":
    main()
