# SPDX-License-Identifier: GPL-2.0-or-later
"""Compressed recordings: any player opens the files, finished, left and recovered, and no frame is lost silently."""
from __future__ import annotations

import itertools
import os
import pathlib
import signal
import subprocess

import pytest

from .mp4 import fragments, probe, shown, stamps, table, top
from .programs import (Counters, Desk, Process, ffmpeg, lost, make_clip, pictures, preload, result, start_recorder,
                       stop, times, wait_for_recorder, wait_until)
from .test_python import MODULES

pytestmark = pytest.mark.strict

SECOND = 1_000_000_000
GAP_MOST = 1800 * 1_000_000  # us
CLIENT = pathlib.Path(__file__).with_name("times_client.py")
BEGUN = ["ftyp", "free", "moov", "free"]


def write(desk: Desk, capture: list[int], size: tuple[int, int] = (64, 48), layout: str = "YUV420P",
          name: str = "video") -> None:
    subprocess.run(["/usr/bin/python3", "-B", CLIENT, name, *map(str, size), layout, "25", *map(str, capture)],
                   check=True, timeout=60, env={**desk.environment, "PYTHONPATH": str(MODULES)})


def recorded(desk: Desk, capture: list[int], *options: object, size: tuple[int, int] = (64, 48),
             layout: str = "YUV420P", wrapper: tuple[str, ...] = ()) -> tuple[int, Counters, str]:
    """Record frames with these capture times; exit status, counters and messages of the recorder."""
    saver = start_recorder(desk, *options, wrapper=wrapper)
    wait_for_recorder(desk)
    write(desk, capture, size, layout)
    status, counters = stop(saver)
    return status, counters, desk.errors(saver)


def even(count: int, begin: int = 5 * SECOND) -> list[int]:
    return [begin + number * 40_000_000 for number in range(count)]


def mended(desk: Desk) -> str:
    """Start the next recorder, which repairs what the last one left; its messages."""
    before = int(desk.stats("ddxvideosave")["starts"])
    saver = start_recorder(desk, "-output", "out.mp4")
    wait_for_recorder(desk, starts=before + 1)
    assert stop(saver)[0] == 0
    return desk.errors(saver)


def test_frames_times_and_numbers(desk: Desk) -> None:
    """Steps of 1 us and of a whole second, with parts of a us."""
    steps = [40_000_000, 1_000, 1_234_567, 999_999, 1_000_000_000, 33_366_700] * 8
    capture = list(itertools.accumulate(steps, initial=7 * SECOND + 123))
    y4m = start_recorder(desk, "-output", "out.y4m", "-instance", "plain")
    wait_for_recorder(desk, "plain")
    status, counters, _ = recorded(desk, capture, "-output", "out.mp4", "-quality", "0")
    assert stop(y4m)[0] == 0
    assert (status, counters["in"], counters["out"], lost(counters)) == (0, len(capture), len(capture), 0)
    path = desk.folder / "out.mp4"
    data = path.read_bytes()
    us = [(time - capture[0]) // 1000 for time in capture]
    frames = fragments(data)
    assert [frame.time for frame in frames] == us == shown(path)
    assert table(data) == (frames, us[-1] + 40_000)
    assert top(data) == ["ftyp", "mdat", "moov"]
    marks = stamps(path)
    assert [mark.time for mark in marks] == capture and {mark.wall - mark.time for mark in marks} == {1_000_000}
    assert [mark.sequence for mark in marks] == list(range(1, len(capture) + 1))
    assert [(mark.frame, mark.source_sequence) for mark in marks] == [(n, 2 * n) for n in range(len(capture))]
    assert all(frame.key == bool(mark.geometry) for frame, mark in zip(frames, marks))
    keys = [mark.time for mark, frame in zip(marks, frames) if frame.key]
    assert keys[0] == capture[0] and len(keys) == 9 and all(b - a >= SECOND for a, b in itertools.pairwise(keys))
    # Lossless: FFmpeg's pictures and ours are those of the Y4M recording.
    raw = ffmpeg("-i", path, "-fps_mode", "passthrough", "-pix_fmt", "yuv420p", "-f", "rawvideo", "-")
    assert raw == b"".join(pictures(desk.folder / "out.y4m"))
    replayed(desk, path, "out.y4m")


def replayed(desk: Desk, path: pathlib.Path, like: str) -> None:
    """Playing the file gives the pictures and times of this Y4M recording."""
    again = desk.folder / "again.y4m"
    saver = start_recorder(desk, "-output", again, "-name", "again", "-instance", "again")
    wait_for_recorder(desk, "again")
    done = desk.run("ddxvideoload", path, "-name", "again", "-rate", "0", "-readers", "1")
    assert (done.returncode, done.stderr) == (0, "")
    assert stop(saver)[0] == 0
    assert pictures(again) == pictures(desk.folder / like) and times(again) == times(desk.folder / like)


@pytest.mark.parametrize("layout, format", [("YUV422P", "yuv422p"), ("YUV444P", "yuv444p"), ("GREY8", "yuv420p")])
def test_layouts(desk: Desk, layout: str, format: str) -> None:
    y4m = start_recorder(desk, "-output", "out.y4m", "-instance", "plain")
    wait_for_recorder(desk, "plain")
    status, counters, _ = recorded(desk, even(3), "-output", "out.mp4", "-quality", "0", size=(50, 34), layout=layout)
    assert stop(y4m)[0] == 0
    assert (status, counters["out"]) == (0, 3)
    path = desk.folder / "out.mp4"
    stream, = probe(path)["streams"]
    assert (stream["pix_fmt"], stream["width"], stream["height"], stream["nb_frames"]) == (format, 50, 34, "3")
    again = desk.folder / "again.y4m"
    saver = start_recorder(desk, "-output", again, "-name", "again", "-instance", "again")
    wait_for_recorder(desk, "again")
    done = desk.run("ddxvideoload", path, "-name", "again", "-rate", "0", "-readers", "1", "-layout", layout)
    assert (done.returncode, done.stderr) == (0, "")
    assert stop(saver)[0] == 0
    assert pictures(again) == pictures(desk.folder / "out.y4m")


REFUSED = [
    ("GREY16", (64, 48), "64x48 in GREY16, and H.264 has YUV and GREY8 only; record them with -format y4m"),
    ("YUV444P", (63, 48), "63x48 in YUV444P, and H.264 needs an even width and height; record them with -format y4m"),
    ("GREY8", (64, 47), "64x47 in GREY8, and H.264 needs an even width and height; record them with -format y4m"),
    ("RGB24", (64, 48), "RGB24, which no MP4 or Y4M file can hold; ddxlog records it")]


def test_what_cannot_be_encoded(desk: Desk) -> None:
    for number, (layout, size, says) in enumerate(REFUSED):
        name = f"video{number}"
        saver = start_recorder(desk, "-output", "out.mp4", "-name", name, "-instance", name)
        wait_for_recorder(desk, name)
        write(desk, even(2), size, layout, name)
        status, counters = result(saver)
        assert status == 2 and says in desk.errors(saver) and not (desk.folder / "out.mp4").exists()
        assert counters["in"] == lost(counters) > 0


CONTRADICTIONS = [
    (("-output", "out.mp4", "-format", "y4m"), "out.mp4 is the name of an MP4 file; name it .y4m"),
    (("-output", "out.y4m", "-format", "h264"), "out.y4m is the name of a Y4M file; name it .mp4"),
    (("-output", "out", "-format", "mpeg2"), "y4m or h264 is needed"),
    (("-output", "out.y4m", "-quality", "18"), "-quality: Y4M has each picture as it is"),
    (("-output", "rec", "-bitrate", "500"), "-bitrate: Y4M has each picture as it is"),
    (("-output", "out.mp4", "-quality", "9"), "from 10 (best) to 40 is needed, or 0, lossless"),
    (("-output", "out.mp4", "-quality", "41"), "-quality"),
    (("-output", "out.mp4", "-quality", "0", "-bitrate", "500"), "leave one out")]


def test_contradictions(desk: Desk) -> None:
    for options, says in CONTRADICTIONS:
        done = desk.run("ddxvideosave", *options)
        assert done.returncode == 2 and says in done.stderr, options
    assert not list(desk.folder.glob("out*"))


def test_one_frame(desk: Desk) -> None:
    assert recorded(desk, even(1), "-output", "out.mp4", "-bitrate", "100")[0] == 0
    data = (desk.folder / "out.mp4").read_bytes()
    assert table(data) == (fragments(data), 40_000) and shown(desk.folder / "out.mp4") == [0]


def most_in_a_second(path: pathlib.Path) -> int:
    """kbit, of any 25 frames."""
    sizes = [frame.size for frame in fragments(path.read_bytes())]
    return max(sum(sizes[at:at + 25]) for at in range(len(sizes) - 24)) * 8 // 1000


def test_a_bitrate(desk: Desk) -> None:
    """Of noise, which takes more than twice as much without it. x264's buffer of a second is empty at first."""
    savers = [start_recorder(desk, "-output", f"{kbit}.mp4", "-instance", f"save{kbit}", *options)
              for kbit, options in ((0, ()), (1000, ("-bitrate", "1000")))]
    for kbit in (0, 1000):
        wait_for_recorder(desk, f"save{kbit}")
    clip = desk.folder / "clip.y4m"
    clip.write_bytes(ffmpeg("-f", "lavfi", "-i", "testsrc2=size=352x288:rate=25,noise=alls=20:allf=t", "-frames:v",
                            "125", "-pix_fmt", "yuv420p", "-f", "yuv4mpegpipe", "-"))
    assert desk.run("ddxvideoload", clip, "-rate", "0", "-readers", "2").returncode == 0
    for saver in savers:
        status, counters = stop(saver)
        assert (status, counters["out"], lost(counters)) == (0, 125, 0)
    assert most_in_a_second(desk.folder / "0.mp4") > 2000 > most_in_a_second(desk.folder / "1000.mp4")
    assert (desk.folder / "1000.mp4").stat().st_size * 8 // 1000 < 6.5 * 1000


def test_a_clock_that_goes_back(desk: Desk) -> None:
    """A time that does not rise is shown 1 us later; the next ones by their distance from it."""
    capture = [9 * SECOND, 9 * SECOND + 40_000_000, 3 * SECOND, 3 * SECOND, 3 * SECOND + 40_000_000]
    assert recorded(desk, capture, "-output", "out.mp4")[0] == 0
    assert shown(desk.folder / "out.mp4") == [0, 40_000, 40_001, 40_002, 80_002]
    assert [mark.time for mark in stamps(desk.folder / "out.mp4")] == capture
    keys = [frame.key for frame in fragments((desk.folder / "out.mp4").read_bytes())]
    assert keys == [True, False, True, False, False]


@pytest.mark.parametrize("place", ["out.mp4", "rec"])
def test_a_gap_of_31_minutes(desk: Desk, place: str) -> None:
    """In a folder another file begins; in a single file it is shown as 30 minutes."""
    (desk.folder / "rec").mkdir()
    capture = even(2) + even(2, 5 * SECOND + 31 * 60 * SECOND)
    status, counters, _ = recorded(desk, capture, "-output", place, "-format", "h264")
    assert (status, counters["out"]) == (0, 4)
    if place == "rec":
        first, second = sorted((desk.folder / "rec").glob("video-*.mp4"))
        assert shown(first) == shown(second) == [0, 40_000]
    else:
        assert shown(desk.folder / place) == [0, 40_000, GAP_MOST + 40_000, GAP_MOST + 80_000]


def test_through_a_pipe(desk: Desk) -> None:
    """Fragments only, which a player reads as they come."""
    saver = start_recorder(desk, "-output", "-", "-format", "h264",
                           wrapper=("sh", "-c", f'"$@" | cat > {desk.folder}/stream', "sh"))
    wait_for_recorder(desk)
    write(desk, even(30))
    wait_until(lambda: desk.out("ddxvideosave") == 30)
    end_pipeline(saver)
    data = (desk.folder / "stream").read_bytes()
    assert top(data)[:4] == BEGUN and len(fragments(data)) == 30
    assert shown(desk.folder / "stream") == [number * 40_000 for number in range(30)]


def end_pipeline(shell: Process) -> None:
    """Stop the recorder that the shell started."""
    for child in pathlib.Path(f"/proc/{shell.pid}/task/{shell.pid}/children").read_text().split():
        if b"ddxvideosave" in pathlib.Path(f"/proc/{child}/cmdline").read_bytes():
            os.kill(int(child), signal.SIGTERM)
    assert shell.wait(60) == 0


def test_a_pipe_that_is_read_late(desk: Desk) -> None:
    """A frame for which the queue has no room is lost before it is encoded: no picture refers to it, and the next frame
    has the number of lost ones."""
    pipe, count = desk.folder / "pipe", 50
    os.mkfifo(pipe)
    saver = start_recorder(desk, "-output", pipe, "-format", "h264", "-quality", "0", "-ring", "2")
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    wait_for_recorder(desk)
    noise = ("-vf", "noise=alls=10:allf=t")  # so little that pictures refer to each other
    clip = make_clip(desk.folder / "clip.y4m", "352x288", "25", count, "yuv420p", *noise)
    loader = desk.start("ddxvideoload", clip, "-loop", "-readers", "1")
    wait_until(lambda: bool(desk.stats("ddxvideosave")["lost"]["ring"] > 0))
    os.set_blocking(reader, True)
    with open(desk.folder / "read", "wb") as file:
        with subprocess.Popen(["cat"], stdin=reader, stdout=file) as cat:
            os.close(reader)
            out = desk.out("ddxvideosave")
            wait_until(lambda: desk.out("ddxvideosave") > out + 30)
            assert stop(loader)[0] == 0
            status, counters = stop(saver)
            assert cat.wait(60) == 0
    assert status == 0 and counters["in"] == counters["out"] + lost(counters)
    marks = stamps(desk.folder / "read")
    assert len(marks) == counters["out"] == len(probe(desk.folder / "read")["frames"])
    numbers = [mark.sequence for mark in marks]
    missing = [later - earlier - 1 for earlier, later in itertools.pairwise([0, *numbers])]
    assert [mark.lost_ring + mark.lost_store for mark in marks] == missing
    written = pictures(clip)
    shows = ffmpeg("-i", desk.folder / "read", "-fps_mode", "passthrough", "-pix_fmt", "yuv420p", "-f", "rawvideo", "-")
    assert shows == b"".join(written[(number - 1) % count] for number in numbers), "a picture refers to a lost one"


def test_frames_that_the_store_lost(desk: Desk) -> None:
    """A recorder that gets no time: frames overwritten in the store are in the next frame's stamp."""
    saver = desk.start("ddxvideosave", "-output", "out.mp4", "-keep", "4")
    wait_for_recorder(desk)
    writer = subprocess.Popen(["/usr/bin/python3", "-B", CLIENT, "video", "64", "48", "YUV420P", "25",
                               *map(str, even(30))], env={**desk.environment, "PYTHONPATH": str(MODULES)})
    saver.send_signal(signal.SIGSTOP)
    assert writer.wait(60) == 0
    saver.send_signal(signal.SIGCONT)
    wait_until(lambda: bool(desk.stats("ddxvideosave")["in"] == 30))
    status, counters = stop(saver)
    marks = stamps(desk.folder / "out.mp4")
    assert (status, len(marks)) == (0, counters["out"])
    assert counters["lost"]["store"] == sum(mark.lost_store for mark in marks) == 30 - len(marks) > 0


def test_an_encoder_that_fails(desk: Desk) -> None:
    """Its frames are counted, and the next one is a key frame: no picture refers to a missing one."""
    library = preload("coded_faults", desk.folder)
    status, counters, says = recorded(desk, even(12), "-output", "out.mp4", wrapper=(
        "env", f"LD_PRELOAD={library}", "FAILING_AT=5"))
    assert (status, counters["out"], counters["lost"]["encode"], lost(counters)) == (0, 10, 2, 2)
    assert says.count("the encoder failed") == 1
    marks = stamps(desk.folder / "out.mp4")
    assert [mark.lost_encode for mark in marks] == [0] * 5 + [2] + [0] * 4
    assert [bool(mark.geometry) for mark in marks] == [True] + [False] * 4 + [True] + [False] * 4
    assert len(probe(desk.folder / "out.mp4")["frames"]) == 10


@pytest.fixture(scope="module")
def faults(tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    return preload("coded_faults", tmp_path_factory.mktemp("faults"))


def test_killed_at_the_end(desk: Desk, faults: pathlib.Path) -> None:
    """Around each write and flush of a file's end: the next recorder makes the bytes of a finished file."""
    path, contents = desk.folder / "out.mp4", set()
    for number, at in enumerate(["0", "0 KILLED_HALF=1", "1", "2", "3", "4"]):
        named = ("-name", f"video{number}")  # numbers in the store begin at 1
        saver = start_recorder(desk, "-output", "out.mp4", *named, wrapper=(
            "env", f"LD_PRELOAD={faults}", *f"KILLED_AT={at}".split()))
        wait_for_recorder(desk)
        write(desk, even(10), name=named[1])
        saver.send_signal(signal.SIGTERM)
        assert saver.wait(60) == (0 if at == "4" else -signal.SIGKILL)
        assert len(probe(path)["frames"]) == 10, at  # a player opens it as it was left
        if at != "4":
            unfinished = top(path.read_bytes())[1] == "free"
            assert unfinished == (int(at[0]) < 3), at
            assert ("was left unfinished" in mended(desk)) == unfinished
        data = path.read_bytes()
        assert top(data) == ["ftyp", "mdat", "moov"] and len(table(data)[0]) == 10
        contents.add(data)
        path.unlink()
    assert len(contents) == 1


def test_killed_within_a_frame(desk: Desk) -> None:
    """Whole frames are kept, and counted; a file without one is removed."""
    path = desk.folder / "out.mp4"
    saver = start_recorder(desk, "-output", "out.mp4")
    wait_for_recorder(desk)
    write(desk, even(10))
    wait_until(lambda: desk.out("ddxvideosave") == 10)
    saver.kill()
    saver.wait()
    data = path.read_bytes()
    last = fragments(data)[-1]
    path.write_bytes(data[:last.offset + last.size - 1])  # as a disk may show it
    done = desk.run("ddxvideoload", path, "-rate", "0", "-name", "again", "-instance", "again")
    assert done.returncode == 0 and "cut short in frame 9" in done.stderr and desk.stats("again")["out"] == 9
    assert "finished after its last whole frame, it has 9" in mended(desk)
    assert len(table(path.read_bytes())[0]) == len(probe(path)["frames"]) == 9


def test_a_slow_repair_loses_no_frame(desk: Desk, tmp_path: pathlib.Path) -> None:
    """While the disk does not finish the file that was left, frames wait in the queue."""
    path, stalled = desk.folder / "out.mp4", tmp_path / "stalled"
    saver = start_recorder(desk, "-output", path)
    wait_for_recorder(desk)
    write(desk, even(10))
    wait_until(lambda: desk.out("ddxvideosave") == 10)
    saver.kill()
    saver.wait()
    stalled.touch()
    saver = start_recorder(desk, "-output", path, wrapper=(
        "env", f"LD_PRELOAD={preload('stalled_disk', desk.folder)}", f"STALLED_SYNC={stalled}"))
    wait_for_recorder(desk, starts=2)
    write(desk, even(40, 9 * SECOND))
    wait_until(lambda: bool(desk.stats("ddxvideosave")["in"] == 50))
    assert desk.out("ddxvideosave") == 10 and list(desk.folder.glob("out*.mp4")) == [path]
    stalled.unlink()
    status, counters = stop(saver)
    assert (status, counters["out"], lost(counters)) == (0, 50, 0)
    assert [len(table(one.read_bytes())[0]) for one in (path, path.with_name("out-2.mp4"))] == [10, 40]


def test_the_clip_is_played_in_its_time(desk: Desk) -> None:
    """-loop continues the times. test_log_replay.py has -clock."""
    recorded(desk, even(5), "-output", "out.mp4")
    saver = start_recorder(desk, "-output", "again.mp4", "-name", "again", "-instance", "again")
    wait_for_recorder(desk, "again")
    loader = desk.start("ddxvideoload", "out.mp4", "-loop", "-name", "again", "-readers", "1", "-instance", "load")
    wait_until(lambda: desk.out("again") > 12)
    assert stop(loader)[0] == 0 and stop(saver)[0] == 0
    assert set(step for _, step in zip(range(11), steps_of(desk.folder / "again.mp4"))) == {40_000}


def steps_of(path: pathlib.Path) -> list[int]:
    return [later - earlier for earlier, later in itertools.pairwise(shown(path))]


def test_a_damaged_picture_is_named(desk: Desk) -> None:
    recorded(desk, even(40), "-output", "out.mp4")
    path = desk.folder / "out.mp4"
    data = bytearray(path.read_bytes())
    frames = fragments(bytes(data))
    assert [number for number, frame in enumerate(frames) if frame.key] == [0, 25]
    data[frames[3].offset:frames[3].offset + 4] = b"\xff" * 4  # the length of its first NAL unit
    path.write_bytes(data)
    done = desk.run("ddxvideoload", path, "-rate", "0", "-name", "again", "-instance", "again")
    assert done.returncode == 0 and done.stderr.count("frame 3 cannot be decoded") == 1
    counters = desk.stats("again")
    assert (counters["in"], counters["out"], counters["lost"]["decode"]) == (40, 18, 22)


def test_other_mp4_files_are_refused(desk: Desk) -> None:
    clip = make_clip(desk.folder / "clip.y4m", "64x48", "25", 5)
    ffmpeg("-i", clip, "-c:v", "libx264", desk.folder / "other.mp4")
    done = desk.run("ddxvideoload", "other.mp4")
    assert done.returncode == 2 and done.stderr.count("\n") == 1
    assert "not one of ddxvideosave" in done.stderr and "ffmpeg -i FILE" in done.stderr


def loaded(desk: Desk, size: str, head: bytes = b"") -> None:
    """Play three pictures of this size; `head`: instead of the clip's first line."""
    clip = make_clip(desk.folder / f"{size}.y4m", size, "25", 3)
    if head:
        clip.write_bytes(head + clip.read_bytes()[clip.read_bytes().index(b"\n"):])
    assert desk.run("ddxvideoload", clip, "-rate", "0", "-readers", "1").returncode == 0


@pytest.mark.parametrize("place", ["out.mp4", "rec"])
def test_a_size_that_changes(desk: Desk, place: str) -> None:
    """In a folder another file begins; a single file ends, whole."""
    (desk.folder / "rec").mkdir()
    saver = start_recorder(desk, "-output", place, "-format", "h264")
    wait_for_recorder(desk)
    loaded(desk, "64x48")
    loaded(desk, "48x32")
    if place == "rec":
        status, counters = stop(saver)
        files = sorted((desk.folder / "rec").glob("video-*.mp4"))
        sizes = [(probe(path)["streams"][0]["width"], len(probe(path)["frames"])) for path in files]
        assert (status, counters["out"], sizes) == (0, 6, [(64, 3), (48, 3)])
        assert all(top(path.read_bytes()) == ["ftyp", "mdat", "moov"] for path in files)
    else:
        status, counters = result(saver)
        assert "the picture changed from 64x48 to 48x32, and a file holds one kind" in desk.errors(saver)
        assert (status, counters["out"]) == (1, 3) and counters["in"] == 3 + lost(counters)
        assert table((desk.folder / place).read_bytes())[0] == fragments((desk.folder / place).read_bytes())


def test_an_unknown_rate(desk: Desk) -> None:
    """The last frame is shown as long as at 25 frames a second; the others by their times."""
    saver = start_recorder(desk, "-output", "out.mp4")
    wait_for_recorder(desk)
    loaded(desk, "64x48", b"YUV4MPEG2 W64 H48 C420jpeg")
    assert stop(saver)[0] == 0
    data = (desk.folder / "out.mp4").read_bytes()
    frames, duration = table(data)
    assert frames == fragments(data) and duration == frames[-1].time + 40_000
    assert stamps(desk.folder / "out.mp4")[0].geometry[3:5] == (0, 0)


def test_no_room_for_the_table(desk: Desk, small_disk: pathlib.Path) -> None:
    """The file stays playable, and the next recorder finishes it. The table is larger than the rest of a page."""
    count = 220
    clip = make_clip(desk.folder / "clip.y4m", "16x16", "25", count)
    uneven = b"".join(b"FRAME XTIME=%d\n" % (number * number * 1_000_000) + picture
                      for number, picture in enumerate(pictures(clip)))
    clip.write_bytes(clip.read_bytes().split(b"\n", 1)[0] + b"\n" + uneven)
    saver = start_recorder(desk, "-output", small_disk / "out.mp4", "-quality", "40", "-ring", "1000")
    wait_for_recorder(desk)
    assert desk.run("ddxvideoload", clip, "-rate", "0", "-readers", "1").returncode == 0
    wait_until(lambda: desk.out("ddxvideosave") == count)
    with (small_disk / "filler").open("wb", buffering=0) as filler, pytest.raises(OSError):
        while filler.write(bytes(4096)):
            pass
    status, counters = stop(saver)
    path = small_disk / "out.mp4"
    assert (status, counters["out"], lost(counters)) == (1, count, 0)
    assert "has no table, so players cannot seek in it, No space left on device" in desk.errors(saver)
    assert top(path.read_bytes())[:4] == BEGUN and len(probe(path)["frames"]) == count
    (small_disk / "filler").unlink()
    saver = start_recorder(desk, "-output", path)
    wait_for_recorder(desk, starts=2)
    assert stop(saver)[0] == 0 and "was left unfinished; finished" in desk.errors(saver)
    assert top(path.read_bytes()) == ["ftyp", "mdat", "moov"] and len(table(path.read_bytes())[0]) == count


def test_stopped_while_a_pipe_is_full(desk: Desk) -> None:
    """Its reader does not read: the recorder stops nevertheless, and counts what the pipe did not take."""
    pipe = desk.folder / "pipe"
    os.mkfifo(pipe)
    saver = start_recorder(desk, "-output", pipe, "-format", "h264", "-quality", "0")
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    wait_for_recorder(desk)
    write(desk, even(24), (176, 144))
    wait_until(lambda: bool(desk.stats("ddxvideosave")["in"] == 24))
    status, counters = stop(saver)
    data = b""
    while more := os.read(reader, 1 << 16):
        data += more
    os.close(reader)
    assert (status, counters["in"]) == (0, 24) and counters["lost"]["write"] > 0
    assert counters["out"] + lost(counters) == 24 and len(fragments(data)) == counters["out"]


def test_gstreamer(desk: Desk) -> None:
    recorded(desk, even(10), "-output", "out.mp4")
    path = desk.folder / "out.mp4"
    left = desk.folder / "left.mp4"
    data = path.read_bytes()
    end = data.rindex(b"moov") - 4
    left.write_bytes(data[:32] + bytes([0, 0, 0, 16]) + b"free" + bytes(8) + data[48:end - 5])
    for file, count in [(path, 10), (left, 9)]:
        raw = file.with_suffix(".raw")
        subprocess.run(["gst-launch-1.0", "-q", "filesrc", f"location={file}", "!", "qtdemux", "!", "h264parse", "!",
                        "openh264dec", "!", "filesink", f"location={raw}"], check=True, timeout=60)
        assert raw.stat().st_size == count * 64 * 48 * 3 // 2
