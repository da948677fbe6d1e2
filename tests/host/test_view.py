# SPDX-License-Identifier: GPL-2.0-or-later
"""ddxvideoview under a real X server, with real keys; frame numbers are read from its window."""
from __future__ import annotations

import os
import pathlib
import pty
import re
import signal
import subprocess
import time
from collections.abc import Iterator

import numpy
import pytest

from lib.seen import Seen
from parts.media import clip as numbered
from parts.media.crc32c import crc32c
from parts.media.display import Display

from .programs import Desk, pictures, result, stop, wait_until
from .rtp_source import MPEG4, Source, encode
from .stream import PORT, TO_RELAY, Stream
from .test_layout import LAYOUTS
from .test_pool import ENTRY, index_file, recordings, start
from .test_python import MODULES
from .test_recordings_bytes import file
from .test_snap import rgb
from .window import Window

pytestmark = pytest.mark.strict

__all__ = ["file"]  # the fixture

WIDTH, HEIGHT = 352, 288


@pytest.fixture(scope="module")
def display() -> Iterator[Display]:
    display = Display()
    yield display
    display.end()


def make_clip(path: pathlib.Path, frames: int, fields: int = 1, begin: int = 0) -> pathlib.Path:
    """Write grey pictures with their numbers; each further field adds 1000."""
    chroma = bytes([100]) * (WIDTH * HEIGHT * fields // 4) + bytes([150]) * (WIDTH * HEIGHT * fields // 4)
    with path.open("wb") as file:
        file.write(b"YUV4MPEG2 W%d H%d F25:1 Ip A1:1 C420jpeg XDDX_FIELDS=%d\n" % (WIDTH, HEIGHT * fields, fields))
        for number in range(begin, begin + frames):
            luma = numpy.tile(numpy.arange(WIDTH, dtype=numpy.uint8) // 2 + 40, (HEIGHT * fields, 1))
            for field in range(fields):
                numbered.draw_number(luma[field * HEIGHT:], number + 1000 * field)
            file.write(b"FRAME\n" + luma.tobytes() + chroma)
    return path


def play(desk: Desk, clip: pathlib.Path, *options: object, readers: int = 1) -> None:
    """Play a clip at full speed, which waits for readers, so that no frame is lost on a slow machine."""
    done = desk.run("ddxvideoload", clip, "-readers", readers, "-rate", "0", *options)
    assert done.returncode == 0, done.stderr


def check(seen: Seen, number: int, *labels: str) -> None:
    """Check the picture's number, its number as text, and the labels."""
    assert (seen.number(), seen.frame()) == (number, number) and seen.label in labels, seen.text


def test_item(desk: Desk, display: Display) -> None:
    clip = make_clip(desk.folder / "clip.y4m", 40)
    window = Window(desk, display)
    assert window.until(lambda seen: "waiting for video" in seen.text).label == "WAITING"
    play(desk, clip)
    check(window.until(lambda seen: seen.number() == 39), 39, "LIVE", "STALLED")
    window.press("s")
    assert desk.run("ddxvideosnap", "snap.png").returncode == 0
    assert (rgb(desk.folder / "video-000039.png") == rgb(desk.folder / "snap.png")).all()

    check(window.press("space"), 39, "PAUSED")
    check(window.press(*["comma"] * 10), 29, "PAUSED")
    play(desk, clip)  # received, but not shown
    paused = window.until(lambda seen: " 50 newer" in seen.text)
    assert " 50 newer" in paused.text
    check(paused, 29, "PAUSED")
    check(window.press(*["period"] * 9), 38, "PAUSED")
    check(window.press(*["period"] * 2), 0, "PAUSED")
    check(window.press("Home"), 0, "PAUSED")
    check(window.press("comma"), 0, "PAUSED")
    check(window.press("End"), 39, "PAUSED")
    check(window.press("comma"), 38, "PAUSED")
    check(window.press("space"), 39, "LIVE", "STALLED")
    window.display.run("xdotool", "key", "q")
    assert result(window.process)[0] == 0


@pytest.mark.parametrize("layout", LAYOUTS)
def test_item_of_each_layout(desk: Desk, display: Display, layout: str) -> None:
    window = Window(desk, display)
    play(desk, make_clip(desk.folder / "clip.y4m", 3), "-layout", layout)
    check(window.until(lambda seen: seen.number() == 2), 2, "LIVE", "STALLED")
    window.display.run("xdotool", "key", "q")
    assert result(window.process)[0] == 0


def test_file_zoom_fields_and_pixels(desk: Desk, display: Display) -> None:
    clip = make_clip(desk.folder / "clip.y4m", 60, fields=2, begin=7)
    window = Window(desk, display, clip)
    both = window.press("Home", "space")
    while both.label != "PAUSED":  # the clip had reached its end
        both = window.press("space")
    width, height = both.area.shape[1] // 2, both.area.shape[0]
    first = window.press("Home")
    assert first.label == "PAUSED"
    assert [first.number(left, 0, width, height) for left in (0, width)] == [7, 1007], first.text
    assert window.press("End").number(width, 0, width, height) == 66 + 1000
    assert window.press("Left").number(0, 0, width, height) == 41
    assert window.press("Right", "comma", "2").number(*middle(window.see(), 1)) == 65 + 1000
    assert window.press("1").number(*middle(window.see(), 1)) == 65

    # At 1:1 the picture is in the middle; the text describes the pixel under the pointer.
    exact = window.press("z")
    left, top, _, _ = middle(exact, WIDTH)
    luma = numpy.frombuffer(pictures(clip)[58], numpy.uint8)[:WIDTH * HEIGHT].reshape(HEIGHT, WIDTH)
    shown = exact.area[top:top + HEIGHT, left:left + WIDTH]
    assert exact.number(left, top, WIDTH, HEIGHT) == 65
    x, y = 200, 150
    window.point(left + x, top + y)
    red, green, blue = shown[y, x]
    said = f"field 1  {x},{y}  Y {luma[y, x]} U 100 V 150  RGB {red} {green} {blue}"
    assert said in window.until(lambda seen: said in seen.text).text
    # The wheel zooms in at the pointer.
    window.display.run("xdotool", "click", "--repeat", 8, "--delay", 0, 4)
    large = window.press()
    assert said in large.text
    assert (large.area[top + y, left + x] == (red, green, blue)).all()
    assert (large.area[top + y, left + x - 4:left + x + 4] == (red, green, blue)).all(axis=1).sum() >= 5


def middle(seen: Seen, width: int) -> tuple[int, int, int, int]:
    """The position of a field of this width; 1: as large as its shape allows."""
    high, wide = seen.area.shape[:2]
    scale = width / WIDTH if width > 1 else min(wide / WIDTH, high / HEIGHT)
    across, down = int(WIDTH * scale + 1e-6), int(HEIGHT * scale + 1e-6)
    return (wide - across) // 2, (high - down) // 2, across, down


@pytest.mark.parametrize("name, size, becomes", [("video", None, (704, 327)), ("left", (500, 400), (500, 400))])
def test_name_and_size_of_the_window(desk: Desk, display: Display, name: str, size: tuple[int, int] | None,
                                     becomes: tuple[int, int]) -> None:
    """A waiting window gets the size of the first picture, unless the user has resized it."""
    window = Window(desk, display, "-name", name)
    waiting = window.until(lambda seen: seen.label == "WAITING")
    assert waiting.image.shape[1::-1] == (704, 654)
    if size:
        window.display.run("xdotool", "windowsize", "--sync", window.id, *size)
        window.until(lambda seen: seen.image.shape[1::-1] == size)
    clip = make_clip(desk.folder / "clip.y4m", 2, fields=2)
    assert desk.run("ddxvideoload", clip, "-readers", 1, "-rate", 0, "-name", name).returncode == 0
    seen = window.until(lambda seen: seen.image.shape[1::-1] == becomes and seen.frame() == 1)
    assert (seen.image.shape[1::-1], seen.frame()) == (becomes, 1)
    assert display.run("xdotool", "getwindowname", window.id).decode().strip() == f"{name} - ddxvideoview"
    window.close()
    assert result(window.process)[0] == 0


def test_stopped_resized_and_closed(desk: Desk, display: Display) -> None:
    clip = make_clip(desk.folder / "clip.y4m", 30)
    window = Window(desk, display)
    loader = desk.start("ddxvideoload", clip, "-loop", "-readers", "1")
    assert window.until(lambda seen: seen.label == "LIVE").label == "LIVE"
    loader.send_signal(signal.SIGSTOP)
    still = window.until(lambda seen: seen.label == "STALLED")
    check(still, still.number() or 0, "STALLED")
    window.display.run("xdotool", "windowsize", "--sync", window.id, 900, 1010)
    larger = window.until(lambda seen: seen.image.shape == (1010, 900, 3) and seen.label == "STALLED")
    assert larger.number(*middle(larger, 1)) == still.number(), larger.text

    # Frames written while the viewer is frozen are missing, and are shown as missing.
    window.press("space")
    window.process.send_signal(signal.SIGSTOP)
    seen_before = desk.sequence("video")
    loader.send_signal(signal.SIGCONT)
    wait_until(lambda: desk.sequence("video") > seen_before + 20)
    stop(loader)
    window.process.send_signal(signal.SIGCONT)
    newer = desk.sequence("video") - seen_before
    gap = window.press("period")
    found = re.search(r"(\d+) missing before this one(.|\n)*lost \1  (\d+) newer", gap.text)
    assert found and int(found[1]) + int(found[3]) + 1 == newer, gap.text
    window.close()
    assert result(window.process)[0] == 0


# Writes the range of frame 1 of item `video`: a disparity of 8 pixels at 10,20, none elsewhere. Then writes a frame
# with contradictory numbers into another item.
RANGE = """
import sys
import ddx
import numpy
disparity = numpy.zeros((288, 352), numpy.uint16)
disparity[20, 10] = 8 * 16
with ddx.Store() as store:
    with store.create("video.stereo", "DDX_STEREO", "struct { float f; float T; }") as stereo:
        stereo.write({"f": 400.0, "T": 0.12})
    with store.create("video.disparity", "DDX_VIDEO", "struct { int frame; int fields; int width; int height; "
                      "unsigned short y[101376]; }") as item:
        item.write({"frame": 1, "fields": 1, "width": 352, "height": 288, "y": disparity.ravel()})
    with store.create("zzz", "DDX_VIDEO", "struct { int frame; int fields; int width; int height; char y[100]; "
                      "char u[25]; char v[25]; }") as bad:
        bad.write({"frame": 1, "fields": 1, "width": 352, "height": 288, "y": b"", "u": b"", "v": b""})
"""


def write_range(desk: Desk) -> None:
    done = subprocess.run(["/usr/bin/python3", "-B", "-c", RANGE], env={**desk.environment, "PYTHONPATH": str(MODULES)},
                          capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_range_and_bad_numbers(desk: Desk, display: Display) -> None:
    """Three fields, as ddxvideoSVS writes them: the range belongs to the left picture, not to the right one."""
    window = Window(desk, display)
    play(desk, make_clip(desk.folder / "clip.y4m", 3, fields=3))
    assert window.until(lambda seen: seen.frame() == 2) and window.press("space", "comma").frame() == 1
    write_range(desk)
    window.press("z")
    for field, x, said in ("3", 10, "  6.000 m"), ("3", 11, "  range unknown"), ("1", 10, ""):  # 400 * 0.12 / 8
        left, top, _, _ = middle(window.press(field), WIDTH)
        window.point(left + x, top + 20)
        wanted = f"field {field}  {x},20  Y [^m]*{said}$"
        text = window.until(lambda seen: re.search(wanted, seen.text)).text
        assert re.search(wanted, text), text
    window.display.run("xdotool", "windowsize", "--sync", window.id, 640, 558)  # smaller letters, all visible
    narrow = window.until(lambda seen: seen.image.shape[1] == 640)
    left, top, _, _ = middle(narrow, WIDTH)
    window.press("3")
    window.point(left + 211, top + 120)
    assert window.until(lambda seen: seen.text.endswith("  range unknown")).text.endswith("  range unknown")
    assert "range" not in window.press("period").text
    window.press("p")
    bad = window.until(lambda seen: "numbers do not fit" in seen.text)
    assert "zzz" in bad.text and bad.label == "WAITING", bad.text
    back = window.press("n")
    assert "video" in back.text and back.items() == ["> video", "  video.disparity", "  zzz"]
    window.close()
    assert result(window.process)[0] == 0
    assert desk.errors(window.process).count("zzz: a frame that cannot be shown") == 1


def test_too_small_to_be_shown(desk: Desk, display: Display) -> None:
    (desk.folder / "dot.y4m").write_bytes(b"YUV4MPEG2 W1 H1 F25:1 Cmono\nFRAME\n\x80")
    window = Window(desk, display)
    assert desk.run("ddxvideoload", desk.folder / "dot.y4m", "-layout", "GREY8", "-readers", 1).returncode == 0
    seen = window.until(lambda seen: "smaller than" in seen.text)
    assert seen.label == "WAITING" and "a frame that cannot be shown: it is smaller than 2x2" in seen.text, seen.text
    window.close()
    assert result(window.process)[0] == 0


def test_stream(stream: Stream, display: Display) -> None:
    """With ddxdecode's receiver: frame numbers are those in the pictures."""
    desk = stream.desk
    window = Window(desk, display, "-port", PORT, wrapper=stream.network.inside)
    wait_until(lambda: bool(desk.item("ddxvideoview.packets")))
    stream.send()
    stream.play(make_clip(desk.folder / "clip.y4m", 40))
    check(window.until(lambda seen: seen.number() == 39), 39, "LIVE", "STALLED")
    numbers = []
    for _ in range(5):
        seen = window.press("comma")
        check(seen, seen.number() or 0, "PAUSED")
        numbers.append(seen.frame() or 0)
    assert numbers == sorted(set(numbers), reverse=True) and numbers[0] < 39
    window.display.run("xdotool", "key", "q")
    assert window.process.communicate(timeout=60) and window.process.returncode == 0
    counters = desk.stats("ddxvideoview")
    assert counters["in"] == counters["out"] + sum(counters["lost"].values())


def test_stream_with_loss(stream: Stream, display: Display) -> None:
    """Lost frames are shown at once, before the next picture."""
    desk = stream.desk
    window = Window(desk, display, "-port", PORT, "-group", "none", wrapper=stream.network.inside)
    wait_until(lambda: bool(desk.item("ddxvideoview.packets")))
    relay = stream.relay("drop=60")
    stream.send("-codec", "mpeg4", "-wire", 2000, "-bitrate", 1200, "-repair", "off", *TO_RELAY)
    desk.start("ddxvideoload", make_clip(desk.folder / "clip.y4m", 40), "-loop", "-readers", "1")
    assert window.until(lambda seen: seen.label == "LIVE").label == "LIVE"
    relay.send_signal(signal.SIGUSR1)
    bad = window.until(lambda seen: re.search(r"  lost [1-9](.|\n)* lost since the newest frame", seen.text))
    assert " lost since the newest frame" in bad.text and "lost 0" not in bad.text, bad.text
    relay.send_signal(signal.SIGUSR1)
    good = window.until(lambda seen: seen.label == "LIVE" and "since the newest" not in seen.text)
    assert "since the newest" not in good.text
    gap = window.press("space")
    while gap.frame() and "missing before this one" not in gap.text:
        gap = window.press("comma")
    assert re.search(r"PAUSED [1-9]\d* missing before this one", gap.text), gap.text


def test_odd_pictures_of_a_stream(stream: Stream, display: Display) -> None:
    """MPEG-4 has them: the last row and column are left out, and pictures without chroma are refused."""
    desk = stream.desk
    window = Window(desk, display, "-port", PORT, "-group", "none", wrapper=stream.network.inside)
    wait_until(lambda: bool(desk.item("ddxvideoview.packets")))
    source = Source(stream.network, MPEG4)
    for size in "65x49", "64x1":
        source.send(encode(MPEG4, 3, size))
    wait_until(lambda: int(desk.stats("ddxvideoview")["in"]) == source.sent)
    seen = window.until(lambda seen: "3 lost since the newest frame" in seen.text)
    assert "3 lost since the newest frame" in seen.text, seen.text
    window.display.run("xdotool", "key", "q")
    assert window.process.communicate(timeout=60) and window.process.returncode == 0
    counters = desk.stats("ddxvideoview")
    assert counters["out"] == counters["lost"]["decode"] == 3


def test_a_recording_of_several_files(desk: Desk, display: Display) -> None:
    """All files open from any of their names; the first one is truncated."""
    (desk.folder / "rec").mkdir()
    clip = make_clip(desk.folder / "clip.y4m", 70)
    saver = start(desk)
    assert desk.run("ddxvideoload", clip, "-readers", "1", "-rate", "3").returncode == 0
    assert stop(saver)[0] == 0
    files = recordings(desk)
    assert len(files) == 3
    kept = len(pictures(files[0])) - 3
    os.truncate(files[0], files[0].stat().st_size - 2 * WIDTH * HEIGHT * 3 // 2 - 1000)
    window = Window(desk, display, files[1])
    check(window.press("Home", "End"), 69, "PAUSED", "PLAYING")
    check(window.press("space", "Home", *["period"] * (kept - 1)) if window.see().label != "PAUSED" else
          window.press("Home", *["period"] * (kept - 1)), kept - 1, "PAUSED")
    gap = window.press("period")
    check(gap, kept + 3, "PAUSED")
    assert "3 missing before this one" in gap.text and "lost 3" in gap.text
    window.point(200, 100)
    both = window.until(lambda seen: re.search(r"\n100,50  Y .*: cut short, 3 frames are missing$", seen.text)).text
    assert re.search(r"\n100,50  Y .*: cut short, 3 frames are missing$", both), both
    check(window.press("comma"), kept - 1, "PAUSED")


def test_an_index_with_a_frame_of_4_gib(desk: Desk, display: Display, file: pathlib.Path) -> None:
    data = bytearray(index_file(file).read_bytes())
    at = 4096 + ENTRY.size
    entry = list(ENTRY.unpack_from(data, at))
    entry[4] = 2 ** 32 - 64
    entry[-1] = crc32c(ENTRY.pack(*entry)[:-4])
    ENTRY.pack_into(data, at, *entry)
    index_file(file).write_bytes(data)
    os.truncate(file, 2 ** 33)
    window = Window(desk, display, file)
    seen = window.press("End")
    assert "frame 1: damaged" in seen.text, seen.text
    window.close()
    assert result(window.process)[0] == 0


def test_bad_input(desk: Desk, display: Display, small_disk: pathlib.Path) -> None:
    desk.environment["DISPLAY"] = display.name
    play(desk, make_clip(desk.folder / "clip.y4m", 2), readers=0)
    (desk.folder / "clip.mp4").write_bytes(b"\0\0\0 ftypisom\0\0\2\0isomiso2avc1mp41\n")
    bad: list[tuple[list[str], int, str]] = [
        (["-name", "ddxvideoload.stats"], 1, "ddxvideoload.stats: no video item"),
        (["clip.mp4"], 2, "clip.mp4: an MP4 file, but not one of ddxvideosave; make a Y4M file: ffmpeg -i FILE"),
        (["none.y4m"], 2, "none.y4m: cannot be opened: No such file"), ([str(desk.folder)], 2, "no regular file")]
    for arguments, status, text in bad:
        done = desk.run("ddxvideoview", *arguments)
        assert (done.returncode, done.stderr.count("\n")) == (status, 1) and text in done.stderr, done.stderr
    wait_until(lambda: time.monotonic_ns() - int(desk.item("video")["time_ns"]) > 1_000_000_000)
    (small_disk / "filler").write_bytes(bytes(64 << 10))
    desk.folder = small_disk
    window = Window(desk, display)
    assert window.until(lambda seen: seen.label != "WAITING").label == "STALLED"  # from the start
    full = window.press("s")
    assert "No space left on device" in full.text
    assert [path.name for path in small_disk.glob("*.png*")] == []


def test_no_display_in_the_background(desk: Desk) -> None:
    """Started with `&`, as in the paper, it prints a line, though terminals may stop background programs that write."""
    environment = {**desk.environment, "PATH": os.environ["PATH"]}
    environment.pop("DISPLAY", None)
    environment.pop("WAYLAND_DISPLAY", None)
    main, terminal = pty.openpty()
    program = pathlib.Path(desk.store.args[-3] if isinstance(desk.store.args, list) else "").with_name("ddxvideoview")
    shell = subprocess.Popen(["setsid", "-c", "sh", "-m", "-c",
                              f"stty tostop; {program} -name video & wait $!; echo status $?"],
                             stdin=terminal, stdout=terminal, stderr=terminal, env=environment)
    os.close(terminal)
    said = b""
    while b"status" not in said:
        said += os.read(main, 1000)
    shell.wait()
    os.close(main)
    assert b"no display: neither DISPLAY nor WAYLAND_DISPLAY is set; no screen: " in said and b"status 1" in said, said
