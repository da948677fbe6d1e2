# SPDX-License-Identifier: GPL-2.0-or-later
"""python_client.py FUNCTION: what a Python program may do with a store; test_python.py runs each function."""
from __future__ import annotations

import fractions
import functools
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

import ddx
import ddxvideo

SENSOR = """struct { char name[12]; struct { struct { float x, y; } accel[2]; double bias[3]; int8_t temperature; } imu;
    uint8_t id; int64_t ticks; }"""
VALUE: dict[str, Any] = {"name": "front", "imu": {"accel": [{"x": 1.5, "y": -2.0}, {"x": 0.0, "y": 8.0}],
                                                  "bias": [1.0, 2.0, 3.0], "temperature": -128}, "id": 255,
                         "ticks": 2**63 - 1}
PICTURE = "struct { int width; char y[307200]; }"


def refused(error: type[Exception], action: Callable[[], object]) -> str:
    try:
        action()
    except error as caught:
        return str(caught)
    raise AssertionError(f"not refused with {error.__name__}")


def values(store: ddx.Store) -> None:
    with store.create("sensor", "SENSOR", SENSOR) as out, store.item("sensor") as item:
        assert refused(TimeoutError, lambda: item.read(timeout=0))
        out.write(VALUE, time=12345)
        assert item.read() == VALUE
        with item.acquire(0, ddx.CURRENT) as frame:
            assert (frame.time, frame.sequence, frame.missed) == (12345, 1, 0)
            assert frame["id"] == 255 and frame["imu"]["accel"][1]["y"] == 8
            assert frame["imu"]["bias"].tolist() == [1, 2, 3]
        assert item.type == "SENSOR" and [f.name for f in item.fields][:3] == ["name", "imu", "imu.accel"]


def wrong_types(store: ddx.Store) -> None:
    """The error names the argument."""
    wrong: Any = 8000
    text: Any = "x"
    assert "Store(): host is a machine's name, not 8000" == refused(TypeError, lambda: ddx.Store(wrong))
    assert "port is a number" in refused(TypeError, lambda: ddx.Store(None, text))
    assert "timeout is a number of seconds" in refused(TypeError, lambda: ddx.Store(timeout=text))
    assert "item(): name is an item's name, not 8000" == refused(TypeError, lambda: store.item(wrong))
    assert "create(): type is a type's name" in refused(TypeError, lambda: store.create("one", wrong, "int"))
    assert "no catalog" in refused(ddx.Error, lambda: ddx.Store("carol", timeout=0.0))


def plain_number(store: ddx.Store) -> None:
    with store.create("count", "int", "int") as out:
        out.write(-7)
        assert out.read() == -7


def wrong_values(store: ddx.Store) -> None:
    """A refused value is not written, not even in part."""
    with store.create("sensor", "SENSOR", SENSOR) as out, store.item("sensor") as item:
        out.write(VALUE)
        cases: list[tuple[type[Exception], dict[str, Any]]] = [
            (OverflowError, {"id": 256}), (OverflowError, {"ticks": 2**63}), (TypeError, {"id": 1.5}),
            (ValueError, {"name": "x" * 13}), (KeyError, {"other": 1}), (KeyError, {"imu": {}})]
        for error, change in cases:
            changed: dict[str, Any] = {**VALUE, "name": "rear"}
            changed |= change
            assert refused(error, lambda changed=changed: out.write(changed))  # type: ignore[misc]
        assert refused(KeyError, lambda: out.write({"id": 1}))
        with item.acquire(0, ddx.CURRENT) as frame:
            assert frame.sequence == 1 and frame.value() == VALUE


def no_copy(store: ddx.Store) -> None:
    """Two handles share their pages: a view shows data written after it was taken."""
    with store.create("picture", "PICTURE", PICTURE, {"y": 76800}) as out, store.item("picture") as item:
        with out.loan() as loan:
            loan["width"] = 320
            loan["y"][:] = np.arange(76800, dtype=np.uint32) % 251
        with item.acquire(1.0, ddx.CURRENT) as frame:
            assert frame["width"] == 320 and frame["y"].shape == (76800,) and frame["y"].dtype == np.uint8
            assert (frame["y"] == np.arange(76800) % 251).all()
            assert not frame["y"].flags.owndata and not frame["y"].flags.writeable
            assert frame.view("y").ctypes.data == frame.address + item.fields[1].offset
            assert refused(ValueError, lambda: frame["y"].__setitem__(0, 1))
            refused(ValueError, lambda: setattr(frame["y"].flags, "writeable", True))
            # A held value does not change while others are written.
            for level in range(10):
                with out.loan() as loan:
                    loan["y"][:] = level
            assert (frame["y"] == np.arange(76800) % 251).all()


def after_release(store: ddx.Store) -> None:
    with store.create("picture", "PICTURE", PICTURE) as out, store.item("picture") as item:
        with out.loan() as loan:
            loan["y"][:] = 3
            kept = loan["y"]
        assert refused(ValueError, lambda: kept.__setitem__(0, 1))
        with item.acquire(1.0, ddx.CURRENT) as frame:
            y, part, square = frame["y"], frame["y"][100:200], frame["y"].reshape(480, 640)
            copy, doubled, ordered = y.copy(), y * np.uint8(2), part.flatten()
            assert y.mean() == 3 and np.concatenate([part, part]).sum() == 600
        for use in [lambda: y[0], lambda: y + 1, lambda: y.mean(), lambda: np.concatenate([part, part]),
                    lambda: square[0, 0], lambda: part.copy(), lambda: np.mean(square), lambda: y.tolist(),
                    lambda: frame["y"], lambda: frame.value()]:
            assert "released" in refused(ValueError, use)
        assert copy.sum() == 3 * 307200 and copy[5] == 3 and (doubled[:10] == 6).all() and ordered[0] == 3


def missed(store: ddx.Store) -> None:
    with store.create("count", "int", "int") as out, store.item("count") as item:
        refused(TimeoutError, lambda: item.acquire(0))
        for number in range(10):
            out.write(number)
        with item.acquire(0) as frame:
            assert (frame.value(), frame.sequence, frame.missed) == (9, 10, 9)
        assert item.missed == 9
        with store.item("count") as late:
            late.keep(5)
            refused(TimeoutError, lambda: late.acquire(0, ddx.NEXT))
            # The store makes room for five soon after the first read; until then values are missed and counted.
            read: list[int] = []
            for attempt in range(1, 100):
                for number in range(4):
                    out.write(number)
                now = [frame.value() for frame in late.frames(0, ddx.IN_ORDER)]
                read += now
                assert len(read) + late.missed == 4 * attempt
                if len(now) == 4:
                    break
                time.sleep(0.05)
            assert now == [0, 1, 2, 3]


def awaited(store: ddx.Store) -> None:
    """A reader that waits for an item gets every value from the first one on."""
    with store.item("later", awaited=True) as item:
        item.keep(4)
        assert item.type == "" and item.fields == []
        refused(TimeoutError, lambda: item.acquire(0, ddx.IN_ORDER))
        refused(ddx.Error, lambda: store.item("later"))
        with store.create("later", "SHORT", "struct { int number; }") as writer:
            for number in range(1, 5):
                writer.write({"number": number})
            assert [item.read(0, ddx.IN_ORDER)["number"] for _ in range(4)] == [1, 2, 3, 4]
            assert item.type == "SHORT" and item.missed == 0


def errors(store: ddx.Store) -> None:
    assert "no item of this name" in refused(ddx.Error, lambda: store.item("nothing"))
    for declaration, word in (("struct { int *p; }", "`*p`"), ("struct { int a; enum colour c; }", "`enum colour`"),
                              ("struct { struct point p; }", "`struct point`"), ("struct { int a : 3; }", "`: 3`"),
                              ("struct { std::int32_t a; }", "`std::int32_t`"), ("struct { int a;", "not complete"),
                              ("struct { long double d; }", "`long double`"), ("struct { string s; }", "`string`")):
        said = refused(ddx.Error, functools.partial(store.create, "p", "P", declaration))
        assert f"p: {word}" in said.replace("the declaration of the type is ", ""), said
    out = store.create("count", "int", "int")
    assert "another program writes" in refused(ddx.Error, lambda: store.create("count", "int", "int"))
    out.write(1)
    frame = out.acquire(0, ddx.CURRENT)
    assert "still held" in refused(ddx.Error, lambda: out.acquire(0))
    out.close()
    assert refused(ValueError, lambda: out.write(2)) and refused(ValueError, frame.value)
    assert "no store runs" in refused(ddx.Error, lambda: ddx.Store(port=7, timeout=0))


def unknown_field(store: ddx.Store) -> None:
    with store.create("picture", "PICTURE", PICTURE) as out, out.loan() as loan:
        for use in (lambda: loan["nope"], lambda: loan.__setitem__("nope", 1)):
            assert "picture has no field 'nope'; its fields are width, y" in refused(KeyError, use)


def video_planes(store: ddx.Store) -> None:
    """Views without a copy: rows and columns of each plane, and the common video header."""
    ntsc = fractions.Fraction(30000, 1001)
    with ddxvideo.create_video(store, "video", 64, 48, ntsc, fields=2) as out, store.item("video") as item:
        with out.loan() as loan:
            planes = ddxvideo.picture(loan)
            assert [plane.shape for plane in planes] == [(48, 64), (24, 32), (24, 32)]
            planes.y[:], planes.u[:], planes.v[:] = np.arange(48)[:, None], 90, 240
            kept = planes.y
        assert "released" in refused(ValueError, lambda: kept[0, 0])
        with item.acquire(0, ddx.CURRENT) as frame:
            assert [frame[name] for name in ("width", "height", "fields", "rate_num", "rate_den", "frame")] == [
                64, 48, 2, 30000, 1001, 0]
            y, u, v = ddxvideo.picture(frame)
            assert (y[:, 5] == np.arange(48)).all() and (u == 90).all() and v.shape == (24, 32)
            assert not y.flags.owndata and not y.flags.writeable
            source = frame["time"], frame["wall_offset"]
            assert 0 <= ddx.time_now() - source[0] < 10**9 * 60 and abs(sum(source) - time.time_ns()) < 10**9 * 60
            with ddxvideo.create_video(store, "edges", 64, 48) as edges:
                with edges.loan(like=frame) as made:
                    ddxvideo.picture(made).y[:] = 255 - y
                copied = edges.acquire(0, ddx.CURRENT)
                assert (copied["time"], copied["wall_offset"]) == source and copied["y"][0] == 255
                assert (copied["rate_num"], copied["rate_den"]) == (0, 0)
        with out.loan():
            pass
        assert item.read()["frame"] == 1


def video_colours(store: ddx.Store) -> None:
    """The eight corners of the colour cube, in both ranges, with the installed converter."""
    with ddxvideo.create_video(store, "video", 16, 8) as out:
        for full, corners in ((1, ((16, 128, 128, 0, 0, 0), (235, 128, 128, 255, 255, 255), (81, 90, 240, 0, 0, 255),
                                   (41, 240, 110, 255, 0, 0), (145, 54, 34, 0, 255, 0))),
                              (2, ((0, 128, 128, 0, 0, 0), (255, 128, 128, 255, 255, 255), (76, 85, 255, 0, 0, 254)))):
            for y, u, v, *colour in corners:
                with out.loan() as loan:
                    planes = ddxvideo.picture(loan)
                    planes.y[:], planes.u[:], planes.v[:], loan["range"] = y, u, v, full
                image = ddxvideo.bgr(out.acquire(0, ddx.CURRENT))
                out._held.release()  # type: ignore[union-attr]
                assert image.shape == (8, 16, 3) and (abs(image.astype(int) - colour) <= 3).all(), (colour, image[0, 0])


def video_layouts(store: ddx.Store) -> None:
    """Planes and colours of each layout; functions for 4:2:0 only are refused."""
    shapes: dict[str, list[tuple[int, ...]]] = {
        "YUV420P": [(6, 8), (3, 4), (3, 4)], "YUV422P": [(6, 8), (6, 4), (6, 4)], "YUV444P": [(6, 8)] * 3,
        "GREY8": [(6, 8)], "GREY16": [(6, 8)], "RGB24": [(6, 8, 3)]}
    assert list(shapes) == list(ddxvideo.LAYOUTS)
    red = {1: [76], 3: [81, 90, 240]}  # without and with chroma
    for name, planes in shapes.items():
        with ddxvideo.create_video(store, name, 8, 6, layout=name) as out:
            with out.loan() as loan:
                made = ddxvideo.planes(loan)
                assert [plane.shape for plane in made] == planes
                if name == "RGB24":
                    made[0][:] = 255, 0, 0
                for plane, value in zip(made, [] if name == "RGB24" else red[len(planes)]):
                    plane[:] = value << 8 if name == "GREY16" else value
            with out.acquire(0, ddx.CURRENT) as frame:
                assert ddxvideo.layout(frame).name == name and frame.value()["width"] == 8
                colour = (70, 70, 70) if len(planes) == 1 and name != "RGB24" else (0, 0, 255)
                assert (abs(ddxvideo.bgr(frame).astype(int) - colour) <= 3).all(), (name, ddxvideo.bgr(frame)[0, 0])
                assert ddxvideo.planes(frame)[0].dtype == ("u2" if name == "GREY16" else "u1")
                if name != "YUV420P":
                    assert name in refused(ValueError, lambda: ddxvideo.picture(frame))
    with ddxvideo.create_video(store, "odd", 7, 5, layout="GREY16") as out, out.loan() as loan:
        assert ddxvideo.planes(loan)[0].shape == (5, 7)
    assert "YUV411P" in refused(ValueError, lambda: ddxvideo.create_video(store, "v", 8, 6, layout="YUV411P"))
    assert "7x6" in refused(ValueError, lambda: ddxvideo.create_video(store, "v", 7, 6, layout="YUV422P"))


def video_refused(store: ddx.Store) -> None:
    for width, height, fields in ((63, 48, 1), (64, 46, 2), (0, 2, 1), (8194, 2, 1), (64, 48, 0)):
        assert f"{width}x{height}" in refused(
            ValueError, functools.partial(ddxvideo.create_video, store, "v", width, height, 25, fields))
    with ddxvideo.create_video(store, "video", 64, 48) as out, out.loan() as loan:
        loan["height"] = 480
        assert "y holds 3072 bytes, 30720 are needed" in refused(ValueError, lambda: ddxvideo.picture(loan))


def gone_with_its_exception(store: ddx.Store) -> None:
    def fails() -> None:
        with out.loan() as loan:
            loan["width"] = 2
            raise RuntimeError
    with store.create("picture", "PICTURE", PICTURE) as out:
        with out.loan() as loan:
            loan["width"] = 1
        refused(RuntimeError, fails)
        assert out.acquire(0, ddx.CURRENT)["width"] == 1


if __name__ == "__main__":
    with ddx.Store() as connection:
        globals()[sys.argv[1]](connection)
