# SPDX-License-Identifier: GPL-2.0-or-later
import ddx

with ddx.Store() as store, store.item("video") as item:
    for frame in item.frames(timeout=1.0):  # no copy; it cannot change until the next one is asked for
        # frame.time: when it was written; frame["time"]: when the picture was captured
        print(frame.sequence, frame.time, frame.missed, frame["y"].sum())
