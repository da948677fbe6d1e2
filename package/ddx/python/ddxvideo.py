# SPDX-License-Identifier: LGPL-2.1-or-later
"""Video items for Python: pictures as numpy arrays in the shared memory, without a copy.

    import ddx, ddxvideo
    with ddx.Store() as store, store.item("video", awaited=True) as video:
        for frame in video.frames():
            y, u, v = ddxvideo.picture(frame)      # y[row, column]; valid until the next frame
            image = ddxvideo.bgr(frame)            # a copy, in OpenCV's format

    with ddxvideo.create_video(store, "edges", 640, 480, 25) as edges, edges.loan(like=frame) as out:
        ddxvideo.picture(out).y[:] = picture       # published at the end of `with`
    with ddxvideo.create_video(store, "depth", 640, 480, layout="GREY16") as depth, depth.loan() as out:
        ddxvideo.planes(out)[0][:] = millimetres   # numpy's uint16

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
# Struct DDX_VIDEO of ddxvideo.h, with the samples and the bounds of its planes left open.
DECLARATION = """struct { int frame; int fields; int width; int height; {sample} y[{luma}]; {sample} u[{chroma}];
    {sample} v[{chroma}]; int64_t time; int64_t wall_offset; int64_t source_sequence; int64_t source_lost;
    int rate_num; int rate_den; int aspect_num; int aspect_den; int format; int interlacing; int range;
    int reserved[5]; }"""
ABOUT_THE_FRAME = "frame", "time", "wall_offset", "source_sequence", "source_lost"

Array = np.ndarray[Any, Any]


class Layout(NamedTuple):
    """A layout of planes; ddxvideo.h lists them."""
    name: str
    format: int                     # enum ddx_video_format; of the four of 4:2:0 the first one
    sample: str                     # C type of a sample
    samples: int                    # of a pixel, in plane y
    chroma: tuple[int, int] | None  # columns and rows that share a chroma sample; None: no u and v

    @property
    def dtype(self) -> np.dtype[Any]:
        return np.dtype("u2" if self.sample == "unsigned short" else "u1")

    def shapes(self, width: int, height: int) -> list[tuple[int, ...]]:
        """The shapes of the planes."""
        luma = (height, width) if self.samples == 1 else (height, width, self.samples)
        chroma = (height // self.chroma[1], width // self.chroma[0]) if self.chroma else ()
        return [luma, chroma, chroma] if chroma else [luma]

    def fits(self, width: int, height: int, fields: int = 1) -> bool:
        columns, rows = self.chroma or (1, 1)
        return (0 < width <= SIDE and 0 < height <= SIDE and 1 <= fields <= FIELDS and not width % columns
                and not height % (rows * fields))


LAYOUTS = {layout.name: layout for layout in (
    Layout("YUV420P", 0, "char", 1, (2, 2)),
    Layout("YUV422P", 16, "unsigned char", 1, (2, 1)),
    Layout("YUV444P", 17, "unsigned char", 1, (1, 1)),
    Layout("GREY8", 18, "unsigned char", 1, None),
    Layout("GREY16", 19, "unsigned short", 1, None),
    Layout("RGB24", 20, "unsigned char", 3, None))}
_OF_FORMAT = {layout.format: layout for layout in LAYOUTS.values()} | dict.fromkeys(range(4), LAYOUTS["YUV420P"])


class Picture(NamedTuple):
    """The planes of a frame, views of the shared memory: y is height x width, u and v are half of that each way.
    Stacked fields (a stereo pair) are one below the other; each has height / fields rows."""
    y: Array
    u: Array
    v: Array


def layout(frame: ddx.Frame | ddx.Loan) -> Layout:
    """The layout of a held or loaned frame."""
    format = frame["format"] if "format" in frame.outer else 0
    if format not in _OF_FORMAT:
        raise ValueError(f"{frame.item.name}: unknown format {format}")
    return _OF_FORMAT[format]


def planes(frame: ddx.Frame | ddx.Loan) -> tuple[Array, ...]:
    """The planes of a held or loaned frame of any layout (see layout()): y, u and v, or one plane of grey (GREY16: of
    16 bits) or of red, green and blue (height x width x 3). They are read-only in a held frame, and valid until its
    release."""
    width, height, kind = frame["width"], frame["height"], layout(frame)
    if not kind.fits(width, height):
        raise ValueError(f"{frame.item.name}: no picture of {width}x{height} can be in {kind.name}")
    found = []
    for name, shape in zip("yuv", kind.shapes(width, height)):
        plane, needed = frame.view(name), int(np.prod(shape))
        if plane.dtype.itemsize != kind.dtype.itemsize:
            raise ValueError(f"{frame.item.name}: {name} has samples of {plane.dtype.itemsize} bytes, in {kind.name} "
                             f"they have {kind.dtype.itemsize}")
        if plane.size < needed:
            raise ValueError(f"{frame.item.name}: {name} holds {plane.nbytes} bytes, "
                             f"{needed * plane.dtype.itemsize} are needed")
        found.append(plane[:needed].reshape(shape))
    return tuple(found)


def picture(frame: ddx.Frame | ddx.Loan) -> Picture:
    """The planes of a held or loaned 4:2:0 frame, as planes(). ValueError for any other layout."""
    if layout(frame).name != "YUV420P":
        raise ValueError(f"{frame.item.name}: its pictures are {layout(frame).name}, not 4:2:0; planes() takes them")
    return Picture(*planes(frame))


def bgr(frame: ddx.Frame | ddx.Loan) -> Array:
    """A copy in colour, height x width x 3, by ITU-R BT.601, of any layout. The planes are not contiguous in an item,
    so OpenCV needs a copy of them first. Without OpenCV, and for other layouts than 4:2:0, numpy converts, which takes
    longer."""
    kind, copies = layout(frame), [np.asarray(plane[:]) for plane in planes(frame)]
    full = frame["range"] == FULL_RANGE if "range" in frame.outer else False
    if kind.samples == 3:
        return copies[0][..., ::-1].copy()
    if kind.dtype.itemsize == 2:
        copies[0] = (copies[0] >> 8).astype(np.uint8)
    if not kind.chroma:
        return np.repeat(_full(copies[0], full)[..., np.newaxis], 3, axis=2)
    cv2: Any = None
    if kind.chroma == (2, 2):
        try:
            cv2 = importlib.import_module("cv2")
        except ImportError:
            pass
    if not cv2:
        return _bgr_by_numpy(Picture(*copies), full, kind.chroma)
    if full:
        copies = [_limited(copies[0], 16, 219 / 255), *(_limited(c, 128 - 128 * 224 / 255, 224 / 255)
                                                        for c in copies[1:])]
    rows, columns = copies[0].shape
    stacked = np.concatenate([plane.ravel() for plane in copies]).reshape(rows * 3 // 2, columns)
    return np.asarray(cv2.cvtColor(stacked, cv2.COLOR_YUV2BGR_I420))


def _full(plane: Array, full: bool) -> Array:
    """Luma with black at 0 and white at 255."""
    if full:
        return plane
    table: Array = np.clip(np.rint((np.arange(256) - 16) * (255 / 219)), 0, 255).astype(np.uint8)
    return np.take(table, plane)


def _limited(plane: Array, offset: float, scale: float) -> Array:
    table: Array = np.rint(np.arange(256) * scale + offset).astype(np.uint8)
    return np.take(table, plane)


def _bgr_by_numpy(planes: Picture, full: bool, shared: tuple[int, int]) -> Array:
    """Tables of 1/64 levels, one for each plane and the colour that it contributes to."""
    luma, chroma = (1.0, 1.0) if full else (255 / 219, 255 / 224)
    levels = np.arange(256)
    y = np.rint((levels - (0 if full else 16)) * luma * 64).astype(np.int32)[planes.y]

    def part(plane: Array, factor: float) -> Array:
        table: Array = np.rint((levels - 128) * chroma * factor * 64).astype(np.int32)
        return np.take(table, plane).repeat(shared[1], axis=0).repeat(shared[0], axis=1)

    result = np.empty((*planes.y.shape, 3), np.uint8)
    for place, colour in enumerate((y + part(planes.u, 1.772), y - part(planes.u, 0.344136) - part(planes.v, 0.714136),
                                    y + part(planes.v, 1.402))):
        result[..., place] = np.clip((colour + 32) >> 6, 0, 255)
    return result


class VideoItem(ddx.Item):
    """A handle for writing a video item: each loan has its size, number and times filled in."""
    facts: dict[str, Any] = {}
    _next = 0

    def loan(self, like: ddx.Frame | None = None) -> ddx.Loan:
        """Get a free frame to draw in. like: the frame that the picture is made from; number and times are copied from
        it. Otherwise frames are numbered from 0, with the current time."""
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
                 fields: int = 1, layout: str = "YUV420P") -> VideoItem:
    """Create a video item, or take it over from a writer that has exited. rate: frames a second, also 30000/1001 as a
    Fraction; 0: unknown. fields: number of fields stacked in a frame; height counts the rows of all. layout: a name in
    LAYOUTS; a program that knows only 4:2:0 cannot open the others."""
    if layout not in LAYOUTS:
        raise ValueError(f"{layout}: the layouts are {', '.join(LAYOUTS)}")
    kind = LAYOUTS[layout]
    if not kind.fits(width, height, fields):
        columns, rows = kind.chroma or (1, 1)
        raise ValueError(f"{width}x{height} with {fields} fields: at most {SIDE} each, with 1 to {FIELDS} fields; in "
                         f"{layout}, the width is a multiple of {columns}, and each field's height of {rows}")
    ratio = fractions.Fraction(rate).limit_denominator(1001)
    if ratio < 0:
        raise ValueError(f"{rate}: no frame rate")
    used = [int(np.prod(shape)) * kind.dtype.itemsize for shape in kind.shapes(width, height)]
    luma, chroma = used[0], used[1] if kind.chroma else 0
    least = (MAX, MAX // 4) if layout == "YUV420P" else (64, 64)
    bounds = [max(small, -(-size // 64) * 64) // kind.dtype.itemsize for small, size in zip(least, (luma, chroma))]
    declaration = DECLARATION.replace("{sample}", kind.sample)
    item = store.create_as(VideoItem, name, "DDX_VIDEO",
                           declaration.replace("{luma}", str(bounds[0])).replace("{chroma}", str(bounds[1])),
                           {"y": luma, "u": chroma, "v": chroma})
    item.facts = {"fields": fields, "width": width, "height": height, "rate_num": ratio.numerator,
                  "rate_den": ratio.denominator if ratio else 0, "aspect_num": 0, "aspect_den": 0,
                  "format": kind.format, "interlacing": 0, "range": FULL_RANGE if kind.samples == 3 else 0,
                  "reserved": [0] * 5}
    return item
