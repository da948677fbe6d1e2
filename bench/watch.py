# SPDX-License-Identifier: GPL-2.0-or-later
"""Watch a CIF item: python -m bench.watch ITEM [FILE]. On SIGTERM it prints a JSON list of [number in the
picture, ns of the write]. FILE gets each picture, as Y, U and V planes, in the same order."""
import contextlib
import json
import os
import signal
import sys
import time

import ddx  # found by PYTHONPATH

from parts.media.clip import HEIGHT, WIDTH, frame_number

KEEP = 64  # frames: after repairing a gap, a stream shows all frames since then at once


def main() -> None:
    name, path = sys.argv[1], sys.argv[2] if len(sys.argv) > 2 else os.devnull
    found: list[tuple[int | None, int]] = []
    stopped: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, _: stopped.append(number))
    with open(path, "wb") as file:
        while not stopped:
            try:
                with ddx.Store() as store, store.item(name, awaited=True) as item:
                    item.keep(KEEP)
                    while not stopped:
                        with contextlib.suppress(TimeoutError), item.acquire(0.2, ddx.IN_ORDER) as frame:
                            file.writelines(frame[plane].tobytes() for plane in "yuv")
                            found.append((frame_number(frame["y"].tobytes(), WIDTH, HEIGHT), frame.time))
            except ddx.Error:
                time.sleep(0.01)
    print(json.dumps(found))


if __name__ == "__main__":
    main()
