# SPDX-License-Identifier: GPL-2.0-or-later
"""Compressed recordings in prepared files: each file plays alone, and no frame is missing between two of them."""
from __future__ import annotations

import itertools
import json
import os
import pathlib
import signal

import pytest

from parts.media.crc32c import crc32c

from .mp4 import fragments, probe, shown, stamps, table, top
from .programs import (KEEP, Counters, Desk, Process, ffmpeg, lost, make_clip, pictures, preload, start_recorder, stop,
                       wait_for_recorder, wait_until)
from .test_mp4 import even, write
from .test_pool import ENTRY, HEADER, NAMED, index_of
from .test_record_commands import command, reached
from .test_recordings import flip, listed, run

pytestmark = pytest.mark.strict

SECOND = 1_000_000_000
GAP = 31 * 60 * SECOND
FRAGMENT = 108  # bytes before a frame's own
KEY = 1         # flag of an index entry


@pytest.fixture(autouse=True)
def folder(desk: Desk) -> pathlib.Path:
    (desk.folder / "rec").mkdir()
    return desk.folder / "rec"


def begin(desk: Desk, *options: object, wrapper: tuple[str, ...] = (), starts: int = 1) -> Process:
    saver = start_recorder(desk, "-output", "rec", "-segment", "4", "-format", "h264", *options, wrapper=wrapper)
    wait_for_recorder(desk, starts=starts)
    return saver


def files(desk: Desk, item: str = "video") -> list[pathlib.Path]:
    return sorted((desk.folder / "rec").glob(f"{item}-*.mp4"))


def recover(desk: Desk) -> str:
    done = desk.run("ddxvideosave", "-output", "rec", "-segment", "4", "-recover")
    assert done.returncode == 0
    return done.stderr


def check(desk: Desk) -> tuple[list[int], Counters]:
    """Each file plays alone; pictures, stamps and index agree. The numbers in the store, and the lost frames."""
    numbers = list[int]()
    missing = {"store": 0, "ring": 0, "encode": 0}
    for path in files(desk):
        data, index = path.read_bytes(), index_of(path)
        frames = fragments(data)
        assert top(data) == ["ftyp", "mdat", "moov"] and table(data)[0] == frames
        assert (index.state, index.name, index.bytes, index.frames) == (NAMED, path.name, len(data), len(frames))
        assert frames[0].key and frames[0].time == 0 and len(probe(path)["frames"]) == len(frames)
        for frame, mark, entry in zip(frames, stamps(path), index.entries, strict=True):
            _, sequence, time, offset, size, _, _, number, store, ring, more, _ = entry
            assert (offset, size) == (frame.offset - FRAGMENT, frame.size + FRAGMENT)
            assert more & 0xffff == (KEY if frame.key else 0)
            assert (sequence, time, number) == (mark.sequence, mark.time, mark.frame)
            lost_before = (store, ring, more >> 16)
            assert lost_before == (mark.lost_store, mark.lost_ring, mark.lost_encode)
            missing = {reason: count + more for (reason, count), more in zip(missing.items(), lost_before)}
        numbers += [mark.sequence for mark in stamps(path)]
    return numbers, missing


def raw(path: pathlib.Path, size: int) -> list[bytes]:
    """The pictures of a file, as any player decodes them."""
    data = ffmpeg("-i", path, "-fps_mode", "passthrough", "-pix_fmt", "yuv420p", "-f", "rawvideo", "-")
    return [data[at:at + size] for at in range(0, len(data), size)]


def noise(path: pathlib.Path, frames: int) -> pathlib.Path:
    """Of which a lossless frame is larger than a raw one, so that files are full soon."""
    path.write_bytes(ffmpeg("-f", "lavfi", "-i", "testsrc2=size=320x240:rate=25,noise=alls=100:allf=t", "-frames:v",
                            frames, "-pix_fmt", "yuv420p", "-f", "yuv4mpegpipe", "-"))
    return path


def play(desk: Desk, clip: pathlib.Path, splits: int, count: int) -> int:
    """Play the clip until that many frames are recorded, with splits on the way; return the files."""
    played = pictures(clip)
    saver = begin(desk, "-quality", "0")
    loader = desk.start("ddxvideoload", clip, "-loop", "-readers", "1")
    for number in range(splits):
        reached(desk, "in", count * (number + 1) // (splits + 1))
        command(desk, "split")
    reached(desk, "in", count)
    assert stop(loader)[0] == 0
    status, counters = stop(saver)
    assert status == 0 and counters["in"] == counters["out"] and lost(counters) == 0
    assert check(desk) == (list(range(1, counters["out"] + 1)), {"store": 0, "ring": 0, "encode": 0})
    decoded = itertools.chain(*(raw(path, len(played[0])) for path in files(desk)))
    assert all(one == other for one, other in zip(decoded, itertools.cycle(played)))
    assert len(listed(desk)) == splits + 1 and run(desk, "verify").returncode == 0
    return len(files(desk))


def test_full_files_and_splits(desk: Desk) -> None:
    """No frame is missing or twice, and each file decodes alone. A file has room for 24 of these frames, and a busy
    machine splits late."""
    assert play(desk, noise(desk.folder / "clip.y4m", 20), 2, 110) > 4


@pytest.mark.long
def test_100_full_files_and_100_splits(desk: Desk) -> None:
    assert play(desk, noise(desk.folder / "clip.y4m", 20), 100, 4300) > 200


def test_a_gap_begins_the_next_file(desk: Desk) -> None:
    """Of the same recording: 20 files of 3 frames."""
    saver = begin(desk)
    capture = [SECOND + file * GAP + frame * 40_000_000 for file in range(20) for frame in range(3)]
    write(desk, capture)
    status, counters = stop(saver)
    assert (status, counters["out"], lost(counters)) == (0, 60, 0)
    assert check(desk)[0] == list(range(1, 61)) and len(files(desk)) == 20
    assert all(shown(path) == [0, 40_000, 80_000] for path in files(desk)[::7])
    one, = listed(desk)
    assert (one["frames"], len(one["files"]), one["state"]) == (60, 20, "finished")


def test_a_full_index_begins_the_next_file(desk: Desk) -> None:
    count = 16_400
    saver = begin(desk, "-segment", "16", "-ring", "20000")
    clip = make_clip(desk.folder / "clip.y4m", "16x16", "25", count)
    loader = desk.run("ddxvideoload", clip, "-rate", "0", "-readers", "1")
    status, counters = stop(saver)
    assert (loader.returncode, status, counters["out"], lost(counters)) == (0, 0, count, 0), (loader.stderr, counters)
    assert [index_of(path).frames for path in files(desk)] == [16_320, count - 16_320]
    assert all(top(path.read_bytes()) == ["ftyp", "mdat", "moov"] for path in files(desk))
    assert fragments(files(desk)[1].read_bytes())[0].key and run(desk, "verify").returncode == 0


def test_lost_frames_are_in_index_and_stamps(desk: Desk) -> None:
    """Frames that the store lost, and frames that the encoder refused."""
    library = preload("coded_faults", desk.folder)
    saver = desk.start("ddxvideosave", "-output", "rec", "-segment", "4", "-format", "h264", "-keep", "4",
                       wrapper=("env", f"LD_PRELOAD={library}", "FAILING_AT=1"))
    wait_for_recorder(desk)
    saver.send_signal(signal.SIGSTOP)
    write(desk, even(60))
    saver.send_signal(signal.SIGCONT)
    wait_until(lambda: bool(desk.stats("ddxvideosave")["in"] == 60))
    status, counters = stop(saver)
    numbers, missing = check(desk)
    assert (status, len(numbers)) == (0, counters["out"])
    assert missing == {reason: counters["lost"][reason] for reason in missing}
    assert missing["store"] > 0 and missing["encode"] == 2
    one, = listed(desk)
    assert one["lost"] == missing


def test_list_and_export(desk: Desk, tmp_path: pathlib.Path) -> None:
    saver = begin(desk)
    write(desk, even(10) + even(10, GAP))
    wait_until(lambda: desk.out("ddxvideosave") == 20)
    now, = listed(desk)
    assert now["state"] == "recording" and run(desk, "verify").returncode == 0
    assert stop(saver)[0] == 0
    plain = start_recorder(desk, "-output", "rec", "-format", "h264", "-instance", "plain", "-name", "plain")
    wait_for_recorder(desk, "plain")
    write(desk, even(5), name="plain")
    assert stop(plain)[0] == 0
    left = desk.folder / "rec/left.mp4"
    data = files(desk, "plain")[0].read_bytes()
    left.write_bytes(data[:32] + bytes([0, 0, 0, 16]) + b"free" + bytes(8) + data[48:fragments(data)[4].offset])
    found = {str(one["recording"]): one for one in listed(desk)}
    assert set(found) == {"left.mp4", "plain-000001", "video-000001"}
    recorded = found["video-000001"]
    assert (recorded["frames"], recorded["seconds"], recorded["state"]) == (20, 0.8, "finished")
    assert (found["plain-000001"]["frames"], found["plain-000001"]["seconds"]) == (5, 0.2)
    assert (found["left.mp4"]["frames"], found["left.mp4"]["state"]) == (4, "cut off")
    assert run(desk, "verify", "video-000001", "plain-000001").returncode == 0
    assert "left.mp4: after 4 whole frames" in run(desk, "verify").stderr
    done = run(desk, "export", "video-000001", tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    copies = sorted(tmp_path.glob("*.mp4"))
    assert [copy.read_bytes() for copy in copies] == [path.read_bytes() for path in files(desk)]


def test_any_flipped_byte_is_named(desk: Desk) -> None:
    saver = begin(desk)
    write(desk, even(30))
    assert stop(saver)[0] == 0
    path, = files(desk)
    data = path.read_bytes()
    frames = fragments(data)
    end = frames[-1].offset + frames[-1].size
    assert run(desk, "verify").stdout == f"{path.name}: good, 30 frames\n"
    places = {at: "its first block, the MP4 header, is not" for at in (0, 6, 33, 38, 47, 60, 600, 4095)}
    places |= {frame.offset + at: f"frame {number} is not" for number, frame in ((0, frames[0]), (29, frames[29]))
               for at in (-FRAGMENT, -1, 0, frame.size - 1)}
    places |= {at: "its table, by which players seek, is not" for at in (end, end + 5, end + 300, len(data) - 1)}
    for at, says in places.items():
        flip(path, at)
        done = run(desk, "verify")
        assert (done.returncode, done.stdout) == (1, "") and says in done.stderr, at
        flip(path, at)
    path.write_bytes(data[:-1])
    assert "its table, by which players seek, is not" in run(desk, "verify").stderr
    path.write_bytes(data + b"x")
    assert "its table, by which players seek, is not" in run(desk, "verify").stderr


END = ["write .y4m", "flush .y4m", "write .y4m 32", "flush .y4m", "write .index 0", "flush .index", "cut .y4m",
       "flush .y4m", "name /rec", "flush /rec", "write .index 0", "flush .index"]


def enders(desk: Desk, *settings: str) -> list[tuple[str, int]]:
    """Recorders of one item, each with these settings of coded_faults.c, record 10 frames and stop; settings and exit
    status of each. Lossless: quality may give way in some of them."""
    library = preload("coded_faults", desk.folder)
    savers = []
    for number, words in enumerate(settings):
        wrapper = ("env", f"LD_PRELOAD={library}", *words.split())
        savers.append(desk.start("ddxvideosave", "-output", "rec", "-segment", "4", "-format", "h264", "-quality",
                                 "0", "-instance", f"save{number}", "-keep", "12", wrapper=wrapper))
    for number in range(len(settings)):
        wait_for_recorder(desk, f"save{number}")
    write(desk, even(10))
    for saver in savers:
        saver.send_signal(signal.SIGTERM)
    return [(words, saver.wait(60)) for words, saver in zip(settings, savers)]


def test_the_end_of_a_file(desk: Desk) -> None:
    """In this order, so that a power cut at any time leaves a file that is finished, or can be."""
    trace = desk.folder / "trace"
    assert enders(desk, f"TRACE={trace}")[0][1] == 0
    assert trace.read_text().splitlines() == END


def test_killed_at_the_end(desk: Desk) -> None:
    """Before each of these calls, and after half of the table: recovery makes the bytes of a finished file."""
    wanted = ["0", "0 KILLED_HALF=1", *map(str, range(1, len(END) + 1))]
    ends = enders(desk, *(f"KILLED_AT={at}" for at in wanted))
    assert [status for _, status in ends] == [-signal.SIGKILL] * (len(END) + 1) + [0]
    named = files(desk)
    assert len(named) == len(END) - END.index("name /rec")
    assert recover(desk).count("it ends after 10 whole frames now") == len(wanted) - len(named)
    assert len(files(desk)) == len(wanted)
    contents = {path.read_bytes() for path in files(desk)}
    assert len(contents) == 1 and top(contents.pop()) == ["ftyp", "mdat", "moov"]
    assert run(desk, "verify").returncode == 0


def test_killed_recorders(desk: Desk) -> None:
    """At any time: what was counted is there, and can be played."""
    clip = noise(desk.folder / "clip.y4m", 20)
    loader = desk.start("ddxvideoload", clip, "-loop")
    out = 0
    for starts in range(1, 4):
        saver = begin(desk, "-quality", "0", starts=starts)
        wait_until(lambda: desk.out("ddxvideosave") > out + 5)
        out = desk.out("ddxvideosave")
        saver.kill()
        saver.wait()
    saver = begin(desk, starts=4)
    wait_until(lambda: desk.out("ddxvideosave") > out + 5)
    stop(loader)
    status, counters = stop(saver)
    assert status == 0 and counters["in"] == counters["out"] + lost(counters)
    numbers, _ = check(desk)
    assert len(numbers) == counters["out"] and numbers == sorted(set(numbers))
    assert run(desk, "verify").returncode == 0
    assert [one["state"] for one in listed(desk)] == ["recovered"] * 3 + ["finished"]


def as_older(desk: Desk) -> None:
    """Finish the left file as a recorder does that has no MP4: cut after the last frame in the index."""
    left = (desk.folder / "rec/pool").glob("*.index")
    index = next(one for one in left if one.read_bytes()[8:9] == b"\2")  # not an empty one that was just made
    data = bytearray(index.read_bytes())
    fields = list(HEADER.unpack_from(data))
    _, _, _, offset, size, *_ = ENTRY.unpack_from(data, 4096 + 9 * ENTRY.size)
    fields[1:3], fields[4] = (NAMED, 10), offset + size
    HEADER.pack_into(data, 0, *fields)
    data[HEADER.size - 4:HEADER.size] = crc32c(bytes(data[:HEADER.size - 4])).to_bytes(4, "little")
    index.write_bytes(data)
    file = index.with_suffix(".y4m")
    os.truncate(file, offset + size)
    os.link(file, desk.folder / "rec" / fields[12].rstrip(b"\0").decode())


def left_by_a_killed_recorder(desk: Desk) -> None:
    """A file with ten frames that are in the index on the disk."""
    saver = begin(desk)
    write(desk, even(10))
    wait_until(lambda: desk.out("ddxvideosave") == 10)
    saver.kill()
    saver.wait()


def test_a_slow_recovery_loses_no_frame(desk: Desk, tmp_path: pathlib.Path) -> None:
    """While the disk does not finish the file that was left, the queue takes the frames."""
    left_by_a_killed_recorder(desk)
    stalled = tmp_path / "stalled"
    stalled.touch()
    saver = begin(desk, starts=2, wrapper=("env", f"LD_PRELOAD={preload('stalled_disk', desk.folder)}",
                                           f"STALLED_SYNC={stalled}"))
    write(desk, even(40, 9 * SECOND))
    wait_until(lambda: bool(desk.stats("ddxvideosave")["in"] >= 50))
    assert not files(desk) and desk.out("ddxvideosave") == 10
    stalled.unlink()
    status, counters = stop(saver)
    assert (status, counters["out"], lost(counters)) == (0, 50, 0)
    assert [index_of(path).frames for path in files(desk)] == [10, 40] and run(desk, "verify").returncode == 0


def test_finished_by_an_older_recorder(desk: Desk) -> None:
    """The file has no table: it plays, and verify reports what it lacks."""
    left_by_a_killed_recorder(desk)
    as_older(desk)
    path, = files(desk)
    assert len(probe(path)["frames"]) == 10
    done = run(desk, "verify")
    assert (done.returncode, done.stdout) == (0, f"{path.name}: good, 10 frames\n")
    assert "has no table, so players cannot seek in it" in done.stderr
    assert recover(desk) == ""  # it has its name, so it stays as it is
    flip(path, fragments(path.read_bytes())[3].offset)
    assert run(desk, "verify").returncode == 1


def test_a_damaged_first_block(desk: Desk) -> None:
    """The frames are kept, and the damage is named."""
    left_by_a_killed_recorder(desk)
    index = next(one for one in (desk.folder / "rec/pool").glob("*.index") if one.read_bytes()[8] == 2)
    flip(index.with_suffix(".y4m"), 100)
    assert "has no table, so players cannot seek in it: its first block is damaged" in recover(desk)
    path, = files(desk)
    assert (index_of(path).state, index_of(path).frames) == (NAMED, 10)
    done = run(desk, "verify")
    assert done.returncode == 1 and "its first block, the MP4 header, is not" in done.stderr


@pytest.mark.parametrize("ring", [64, 4])
def test_pre_roll(desk: Desk, ring: int) -> None:
    """The pre-roll waits encoded, and begins with a key frame; the recording goes on with the same encoder. The first
    pre-roll has more bytes than a file, and the second one less memory than from key frame to key frame."""
    played = pictures(noise(desk.folder / "clip.y4m", 25))
    saver = begin(desk, "-quality", "0", "-start", "paused", "-pre-roll", "2", "-ring", ring)
    loader = desk.start("ddxvideoload", "clip.y4m", "-loop", "-readers", "1")
    reached(desk, "skipped", 5)
    newest = desk.sequence("video")
    command(desk, "start")
    reached(desk, "in", 45)
    command(desk, "stop")
    assert stop(loader)[0] == 0
    status, counters = stop(saver)
    assert status == 0 and lost(counters) == 0
    numbers, _ = check(desk)
    assert len(numbers) == counters["in"] == counters["out"] and (numbers[0] <= newest or ring == 4)
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    shown = [picture for path in files(desk) for picture in raw(path, len(played[0]))]
    assert shown == [played[(number - 1) % 25] for number in numbers]
    assert len(files(desk)) > 1


def test_a_frame_that_no_file_can_hold(desk: Desk) -> None:
    """Twice the raw bytes must fit into a file of 4 MB."""
    saver = begin(desk)
    clip = make_clip(desk.folder / "clip.y4m", "1920x1080", "25", 1)
    desk.run("ddxvideoload", clip, "-readers", "1")
    assert saver.wait(60) == 1 and "File too large" in desk.errors(saver)


@pytest.mark.parametrize("quality, count, keep", [(18, 200, KEEP), (0, 60, 8)])
def test_quality_gives_way_before_frames_do(desk: Desk, quality: int, count: int, keep: int) -> None:
    """An encoder that needs 1.5 frame times at quality 18, and 0.5 at 26: frames are coarser, as many as necessary, and
    counted. Lossless recordings stay lossless."""
    library = preload("coded_faults", desk.folder)
    saver = begin(desk, "-quality", quality, "-keep", keep, wrapper=("env", f"LD_PRELOAD={library}", "SLOW_MS=30"))
    clip = make_clip(desk.folder / "clip.y4m", "64x48", "50", count)
    assert desk.run("ddxvideoload", clip, "-readers", "1").returncode == 0
    wait_until(lambda: bool(desk.stats("ddxvideosave")["in"] == count))
    assert bool(desk.stats("ddxvideosave")["lost"]["store"]) != bool(quality)

    def coarse() -> int:
        text = desk.run("ddxctl", "show", "ddxvideosave.disk", "--json").stdout
        return int(json.loads(text)["value"]["coarse"])

    wait_until(lambda: 0 < coarse() < count or not quality)
    assert bool(coarse()) == bool(quality)
    status, counters = stop(saver)
    assert status == 0 and counters["out"] + lost(counters) == count and (lost(counters) == 0) == bool(quality)
    assert check(desk)[1]["store"] == counters["lost"]["store"]
