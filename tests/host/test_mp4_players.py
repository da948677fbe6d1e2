# SPDX-License-Identifier: GPL-2.0-or-later
"""Players that are not ours open MP4 recordings, finished, cut and recovered, and seek to the right picture."""
from __future__ import annotations

import ctypes
import os
import pathlib
import re
import subprocess
import tempfile

import pytest

from bench.player import Player
from parts.common import MORTAL
from parts.media.clip import frame_number

from .absent import need
from .mp4 import fragments, top
from .programs import Desk, Process, ffmpeg, pictures, start_recorder, stop, wait_for_recorder, wait_until
from .test_mp4 import BEGUN, mended
from .test_view import make_clip

pytestmark = pytest.mark.strict

FRAMES = 100
STEP = 0.1  # s
PLACES = (57, 3, 99, 40, 41, 39, 0, 80)


def record(desk: Desk) -> Process:
    """Pictures with their numbers; each tenth is a key frame."""
    plain = make_clip(desk.folder / "plain.y4m", FRAMES)
    head = plain.read_bytes().split(b"\n", 1)[0]
    clip = desk.folder / "clip.y4m"
    clip.write_bytes(head + b"\n" + b"".join(b"FRAME XTIME=%d\n" % (number * STEP * 1e9) + picture
                                             for number, picture in enumerate(pictures(plain))))
    saver = start_recorder(desk, "-output", "out.mp4")
    wait_for_recorder(desk)
    assert desk.run("ddxvideoload", clip, "-rate", "0", "-readers", "1").returncode == 0
    wait_until(lambda: desk.out("ddxvideosave") == FRAMES)
    return saver


def cut(desk: Desk) -> pathlib.Path:
    """Of a killed recorder; the last frame is not whole."""
    saver = record(desk)
    saver.kill()
    saver.wait()
    path = desk.folder / "out.mp4"
    last = fragments(path.read_bytes())[-1]
    path.write_bytes(path.read_bytes()[:last.offset + 5])
    return path


def make(desk: Desk, state: str) -> pathlib.Path:
    if state == "finished":
        assert stop(record(desk))[0] == 0
    else:
        cut(desk)
    if state == "recovered":
        assert "was left unfinished; finished" in mended(desk)
    path = desk.folder / "out.mp4"
    assert top(path.read_bytes())[:2] == (BEGUN[:2] if state == "cut" else ["ftyp", "mdat"])
    return path


@pytest.mark.long
@pytest.mark.parametrize("state", ["finished", "cut", "recovered"])
def test_chromium(desk: Desk, state: str) -> None:
    path = make(desk, state)
    frames = FRAMES - (state != "finished")
    player = Player(desk.folder / "chromium")
    try:
        length = player.load(path)
        wait_until(lambda: player.number() == 0)  # the first picture may be drawn a moment later
        if state != "cut":
            assert round(length, 3) == round((frames - 1) * STEP + 0.04, 3)
            for place in PLACES:
                place = min(place, frames - 1)
                player.seek(place * STEP + 0.02)
                assert player.number() == place
            player.seek(0)
            player.play()  # where a file is cut within a frame, Chromium stops with an error
            wait_until(lambda: player.number() == frames - 1)
    finally:
        player.end()


@pytest.mark.long
@pytest.mark.parametrize("state", ["finished", "cut", "recovered"])
def test_ffprobe_seeks(desk: Desk, state: str) -> None:
    """To the key frame before the wanted time; in a cut file by its fragments."""
    path = make(desk, state)
    for place in PLACES:
        done = subprocess.run(["ffprobe", "-v", "error", "-read_intervals", f"{place * STEP + 0.02}%+#1",
                               "-show_entries", "packet=pts_time,flags", "-of", "csv=p=0", path],
                              capture_output=True, text=True, check=True)
        time, flags = done.stdout.strip().rstrip(",").split(",")
        assert (round(float(time), 3), flags[0], done.stderr) == (place // 10, "K", ""), place


class GStreamer:
    """Seeks in a file; by ctypes, since its Python module is not needed elsewhere."""
    PAUSED, NULL, TIME, FLUSH, ACCURATE = 3, 1, 3, 1, 2  # of its enumerations

    def __init__(self, path: pathlib.Path) -> None:
        self.core, self.app = ctypes.CDLL("libgstreamer-1.0.so.0"), ctypes.CDLL("libgstapp-1.0.so.0")
        for function in (self.core.gst_parse_launch, self.core.gst_bin_get_by_name, self.core.gst_sample_get_buffer,
                         self.app.gst_app_sink_pull_preroll):
            function.restype = ctypes.c_void_p
        self.core.gst_buffer_get_size.restype = self.core.gst_buffer_extract.restype = ctypes.c_size_t
        self.core.gst_init(None, None)
        line = f"filesrc location={path} ! qtdemux ! h264parse ! openh264dec ! appsink name=sink sync=false"
        self.pipeline = ctypes.c_void_p(self.core.gst_parse_launch(line.encode(), None))
        self.sink = ctypes.c_void_p(self.core.gst_bin_get_by_name(self.pipeline, b"sink"))
        self.core.gst_element_set_state(self.pipeline, self.PAUSED)
        self.number()

    def number(self) -> int | None:
        """The number in the picture that waits; it is of the size of CIF."""
        sample = ctypes.c_void_p(self.app.gst_app_sink_pull_preroll(self.sink))
        buffer = ctypes.c_void_p(self.core.gst_sample_get_buffer(sample))
        size = self.core.gst_buffer_get_size(buffer)
        data = ctypes.create_string_buffer(size)
        self.core.gst_buffer_extract(buffer, ctypes.c_size_t(0), data, ctypes.c_size_t(size))
        self.core.gst_mini_object_unref(sample)
        return frame_number(data.raw[:352 * 288], 352, 288)

    def seek(self, seconds: float) -> int | None:
        assert self.core.gst_element_seek_simple(self.pipeline, self.TIME, self.FLUSH | self.ACCURATE,
                                                 ctypes.c_int64(round(seconds * 1e9)))
        return self.number()

    def end(self) -> None:
        self.core.gst_element_set_state(self.pipeline, self.NULL)
        self.core.gst_object_unref(self.sink)
        self.core.gst_object_unref(self.pipeline)


@pytest.mark.long
@pytest.mark.parametrize("state", ["finished", "recovered"])
def test_gstreamer_seeks(desk: Desk, state: str) -> None:
    path = make(desk, state)
    player = GStreamer(path)
    try:
        for place in PLACES:
            place = min(place, FRAMES - 1 - (state != "finished"))
            assert player.seek(place * STEP + 0.02) == place
    finally:
        player.end()


def said(*command: object, **environment: str) -> str:
    done = subprocess.run([*MORTAL, *map(str, command)], env={**os.environ, **environment}, stdin=subprocess.DEVNULL,
                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace", timeout=120,
                          check=True)
    return done.stdout


def numbers(y4m: pathlib.Path) -> list[int | None]:
    return [frame_number(picture, 352, 288) for picture in pictures(y4m)]


@pytest.mark.long
@pytest.mark.parametrize("state", ["finished", "cut", "recovered"])
def test_mpv(desk: Desk, state: str) -> None:
    """mpv shows each frame, and from any place on, also in a cut file."""
    need("mpv", "mpv")
    path = make(desk, state)
    frames = FRAMES - (state != "finished")
    for place in (0, 57):
        nut, y4m = path.with_suffix(".nut"), path.with_suffix(".y4m")
        said("mpv", "--no-config", "--no-audio", f"--o={nut}", "--of=nut", "--ovc=rawvideo", "--vf=format=yuv420p",
             f"--start={place * STEP}", "--hr-seek=yes", path)
        y4m.write_bytes(ffmpeg("-i", nut, "-fps_mode", "passthrough", "-f", "yuv4mpegpipe", "-"))
        assert numbers(y4m) == list(range(place, frames))


@pytest.mark.long
@pytest.mark.parametrize("state", ["finished", "cut", "recovered"])
def test_ffplay(desk: Desk, state: str) -> None:
    """ffplay shows each frame, if need be late, and seeks to the key frame before a place."""
    need("ffplay", "ffmpeg")
    path = make(desk, state)
    frames = FRAMES - (state != "finished")
    for place in (0, 57):
        text = said("ffplay", "-hide_banner", "-nostats", "-autoexit", "-an", "-noframedrop", "-vf", "showinfo", "-ss",
                    place * STEP, path, SDL_VIDEODRIVER="dummy")
        times = [float(time) for time in re.findall(r" pts_time:([\d.]+)", text)]
        assert [round(time / STEP) for time in times] == list(range(place // 10 * 10, frames))


@pytest.mark.long
@pytest.mark.parametrize("state", ["finished", "cut", "recovered"])
def test_vlc(desk: Desk, state: str) -> None:
    """VLC shows a finished file from any place on, and a cut one from its beginning. It may leave out the first or the
    last frame."""
    need("vlc", "vlc-bin")
    path = make(desk, state)
    frames = FRAMES - (state != "finished")
    for place in (0,) if state == "cut" else (0, 57):
        with tempfile.TemporaryDirectory(prefix="ddx-") as name:  # VLC refuses to run as root
            folder = pathlib.Path(name)
            folder.chmod(0o777)
            (folder / "clip.mp4").write_bytes(path.read_bytes())
            user = ["setpriv", "--reuid=65534", "--regid=65534", "--clear-groups"] if os.geteuid() == 0 else []
            said(*user, "vlc", "-I", "dummy", "--no-audio", "--no-drop-late-frames", "--no-skip-frames",
                 "--vout", "yuv", "--yuv-chroma", "I420", "--yuv-yuv4mpeg2", "--yuv-file", folder / "seen.y4m",
                 "--start-time", place * STEP, "--play-and-exit", folder / "clip.mp4", HOME=name)
            seen = [number for number in numbers(folder / "seen.y4m") if number is not None]
        assert abs(seen[0] - place) <= 1 and max(seen) >= frames - 2
        assert sorted(set(seen)) == list(range(seen[0], max(seen) + 1))
