# SPDX-License-Identifier: GPL-2.0-or-later
"""Where the red thing is: writes the centre and the size of all red pixels of `video` as the item `blob`."""
import numpy as np

import ddx
import ddxvideo

with ddx.Store() as store, store.item("video", awaited=True) as video, \
        store.create("blob", "BLOB", "struct { int frame; int pixels; float x, y; }") as blob:
    for frame in video.frames(timeout=5.0):
        blue, green, red = np.moveaxis(ddxvideo.bgr(frame).astype(int), -1, 0)
        rows, columns = np.nonzero((red > 120) & (red > 2 * green) & (red > 2 * blue))
        seen = len(rows) > 0
        # The time of the picture, not of this write: in a log, the value stands beside the frame it was made from.
        blob.write({"frame": frame["frame"], "pixels": len(rows), "x": columns.mean() if seen else -1,
                    "y": rows.mean() if seen else -1}, time=frame["time"])
