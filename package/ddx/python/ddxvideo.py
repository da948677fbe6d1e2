# SPDX-License-Identifier: LGPL-2.1-or-later
"""Video items for Python: pictures as numpy arrays in the shared memory, without a copy.

    import ddx, ddxvideo
    with ddx.Store() as store, store.item("video", awaited=True) as video:
        for frame in video.frames():
            y, u, v = ddxvideo.picture(frame)      # y[row, column]; valid until the next frame
            image = ddxvideo.bgr(frame)            # a copy, as OpenCV likes it

    with ddxvideo.create_video(store, "edges", 640, 480, 25) as edges, edges.loan(like=frame) as out:
        ddxvideo.picture(out).y[:] = picture       # published at the end of `with`

ddxvideo.h is the manual of what lies beneath. frame["time"] is when the picture was taken; frame.time is when it was
written. What is computed from a picture is written with the former: item.write({...}, time=frame["time"]).
"""
from __future__ import annotations

import fractions
import importlib
import time
from typing import Any, NamedTuple

import numpy as np

import ddx

MAX = 2073600  # DDX_VIDEO_MAX
SIDE = 8192    # DDX_VIDEO_SIDE
FIELDS = 16    # DDX_VIDEO_FIELDS
FULL_RANGE = 2  # DDX_VIDEO_RANGE_FULL
# Struct DDX_VIDEO of ddxvideo.h, with the bound of its planes left open.
DECLARATION = """struct { int frame; int fields; int width; int height; char y[{bound}]; char u[{bound} / 4];
    char v[{bound} / 4]; int64_t time; int64_t wall_offset; int64_t source_sequence; int64_t source_lost;
    int rate_num; int rate_den; int aspect_num; int aspect_den; int format; int interlacing; int range;
    int reserved[5]; }"""
ABOUT_THE_FRAME = "frame", "time", "wall_offset", "source_sequence", "source_lost"

Array = np.ndarray[Any, Any]


class Picture(NamedTuple):
    """The planes of a frame, views of the shared memory: y is height x width, u and v are half of that each way.
    Stacked fields (a stereo pair) lie one below the other; each has height / fields rows."""
    y: Array
    u: Array
    v: Array


def picture(frame: ddx.Frame | ddx.Loan) -> Picture:
    """The planes of a held or loaned frame. They are read-only in the former, and valid until its release."""
    width, height = frame["width"], frame["height"]
    if not (0 < width <= SIDE and 0 < height <= SIDE) or width % 2 or height % 2:
        raise ValueError(f"{frame.item.name}: no picture of {width}x{height} can be in 4:2:0")
    shapes = (height, width), (height // 2, width // 2), (height // 2, width // 2)
    planes = []
    for name, (rows, columns) in zip("yuv", shapes):
        plane = frame.view(name)
        if plane.size < rows * columns:
            raise ValueError(f"{frame.item.name}: {name} holds {plane.size} bytes, {rows * columns} are needed")
        planes.append(plane[:rows * columns].reshape(rows, columns))
    return Picture(*planes)


def bgr(frame: ddx.Frame | ddx.Loan) -> Array:
    """A copy in colour, height x width x 3, by ITU-R BT.601. The planes are not contiguous in an item, so OpenCV needs
    a copy of them first. Without OpenCV numpy converts, which takes longer."""
    planes = Picture(*(np.asarray(plane[:]) for plane in picture(frame)))
    full = frame["range"] == FULL_RANGE if "range" in frame.outer else False
    try:
        cv2 = importlib.import_module("cv2")
    except ImportError:
        return _bgr_by_numpy(planes, full)
    if full:
        planes = Picture(_limited(planes.y, 16, 219 / 255), *(_limited(c, 128 - 128 * 224 / 255, 224 / 255)
                                                            for c in planes[1:]))
    rows, columns = planes.y.shape
    stacked = np.concatenate([plane.ravel() for plane in planes]).reshape(rows * 3 // 2, columns)
    return np.asarray(cv2.cvtColor(stacked, cv2.COLOR_YUV2BGR_I420))


def _limited(plane: Array, offset: float, scale: float) -> Array:
    table: Array = np.rint(np.arange(256) * scale + offset).astype(np.uint8)
    return np.take(table, plane)


def _bgr_by_numpy(planes: Picture, full: bool) -> Array:
    """Tables of 1/64 levels, one for each plane and the colour that it contributes to."""
    luma, chroma = (1.0, 1.0) if full else (255 / 219, 255 / 224)
    levels = np.arange(256)
    y = np.rint((levels - (0 if full else 16)) * luma * 64).astype(np.int32)[planes.y]

    def part(plane: Array, factor: float) -> Array:
        table: Array = np.rint((levels - 128) * chroma * factor * 64).astype(np.int32)
        return np.take(table, plane).repeat(2, axis=0).repeat(2, axis=1)

    result = np.empty((*planes.y.shape, 3), np.uint8)
    for place, colour in enumerate((y + part(planes.u, 1.772), y - part(planes.u, 0.344136) - part(planes.v, 0.714136),
                                    y + part(planes.v, 1.402))):
        result[..., place] = np.clip((colour + 32) >> 6, 0, 255)
    return result


class VideoItem(ddx.Item):
    """A handle on a video item that this program writes: each loan comes with its size, number and times filled in."""
    facts: dict[str, Any] = {}
    _next = 0

    def loan(self, like: ddx.Frame | None = None) -> ddx.Loan:
        """A free frame to draw in. like: its picture is made from that frame, whose number and times it takes; else
        frames are numbered from 0 and are taken now."""
        loan = super().loan()
        source: dict[str, Any] = {name: like[name] for name in ABOUT_THE_FRAME if name in like.outer} if like else {}
        if not like:
            now = ddx.time_now()
            source = {"frame": self._next, "time": now, "wall_offset": time.time_ns() - now}
            self._next += 1
        for name, value in {**dict.fromkeys(ABOUT_THE_FRAME, 0), **self.facts, **source}.items():
            loan[name] = value
        return loan


def create_video(store: ddx.Store, name: str, width: int, height: int, rate: float | fractions.Fraction = 0,
                 fields: int = 1) -> VideoItem:
    """Create a video item of 4:2:0 pictures, or take it over from a writer that is gone. rate: frames a second, also
    30000/1001 as a Fraction; 0: unknown. fields: how many are stacked in a frame; height counts the rows of all."""
    if not (0 < width <= SIDE and 0 < height <= SIDE and 1 <= fields <= FIELDS) or width % 2 or height % (2 * fields):
        raise ValueError(f"{width}x{height} with {fields} fields: width and each field's height are even, "
                         f"at most {SIDE} each, with 1 to {FIELDS} fields")
    ratio = fractions.Fraction(rate).limit_denominator(1001)
    if ratio < 0:
        raise ValueError(f"{rate}: no frame rate")
    luma = width * height
    bound = MAX if luma <= MAX else -(-luma // 64) * 64
    item = store.create_as(VideoItem, name, "DDX_VIDEO", DECLARATION.replace("{bound}", str(bound)),
                           {"y": luma, "u": luma // 4, "v": luma // 4})
    item.facts = {"fields": fields, "width": width, "height": height, "rate_num": ratio.numerator,
                  "rate_den": ratio.denominator if ratio else 0, "aspect_num": 0, "aspect_den": 0, "format": 0,
                  "interlacing": 0, "range": 0, "reserved": [0] * 5}
    return item
