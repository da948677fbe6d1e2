# SPDX-License-Identifier: GPL-2.0-or-later
"""Recording into prepared files: nothing is lost between them, and after a kill each ends with a whole frame."""
from __future__ import annotations

import dataclasses
import pathlib
import signal
import struct
import subprocess
from collections.abc import Iterator

import pytest

from .programs import Desk, Process, ffmpeg, lost, make_clip, pictures, start_recorder, stop, times, wait_until

pytestmark = pytest.mark.strict

SEGMENT = 4 << 20
PICTURE = 352 * 288 * 3 // 2
HEADER = struct.Struct("<8sIIQQqqQQII128s192s3II")
ENTRY = struct.Struct("<QQqQIIIiIIII")
RAW, FREE, RECORDING, FINISHED, NAMED = range(5)
COUNT = 100


@pytest.fixture
def clip(desk: Desk) -> pathlib.Path:
    (desk.folder / "rec").mkdir()
    return make_clip(desk.folder / "clip.y4m", frames=COUNT)


def start(desk: Desk, *options: object) -> Process:
    return start_recorder(desk, "-output", "rec", "-segment", "4", *options)


def recordings(desk: Desk) -> list[pathlib.Path]:
    return sorted((desk.folder / "rec").glob("*.y4m"))


@dataclasses.dataclass
class Index:
    """The index of package/ddxvideo/save/pool/index.h."""
    state: int
    frames: int
    bytes: int
    lost: int
    name: str
    entries: list[tuple[int, ...]]


def index_file(recording: pathlib.Path) -> pathlib.Path:
    inode = recording.stat().st_ino
    file = next(one for one in (recording.parent / "pool").glob("*.y4m") if one.stat().st_ino == inode)
    return file.with_suffix(".index")


def index_of(recording: pathlib.Path) -> Index:
    data = index_file(recording).read_bytes()
    magic, state, frames, _, size, _, _, store, ring, _, _, _, name, *_ = HEADER.unpack_from(data)
    assert magic == b"DDXINDX1" and len(data) == 1 << 20
    entries = [ENTRY.unpack_from(data, 4096 + position * ENTRY.size) for position in range(frames)]
    return Index(state, frames, size, store + ring, name.rstrip(b"\0").decode(), entries)


def check_files(desk: Desk, played: list[bytes]) -> int:
    """Check that each recording is complete, matches its index, and shows the pictures in order; return the frames."""
    frames = 0
    for file in recordings(desk):
        index = index_of(file)
        shown = pictures(file)
        assert (index.state, index.frames, index.bytes, index.name) == (NAMED, len(shown), file.stat().st_size,
                                                                        file.name)
        begin = played.index(shown[0])
        assert shown == [played[(begin + number) % len(played)] for number in range(len(shown))], file
        assert int(ffmpeg("-i", file, "-f", "framemd5", "-").count(b"\n0,")) == len(shown)
        data = file.read_bytes()
        for entry in index.entries:
            assert data[entry[3]:entry[3] + 6] == b"FRAME " and entry[4] - PICTURE < 80
        frames += len(shown)
    return frames


def test_files_follow_each_other_without_a_gap(desk: Desk, clip: pathlib.Path) -> None:
    saver = start(desk)
    loader = desk.run("ddxvideoload", clip, "-readers", "1")
    assert loader.returncode == 0
    status, saved = stop(saver)
    assert status == 0 and saved["in"] == saved["out"] == COUNT and lost(saved) == 0
    played = pictures(clip)
    assert check_files(desk, played) == COUNT
    assert [picture for file in recordings(desk) for picture in pictures(file)] == played
    assert len(recordings(desk)) > COUNT * PICTURE // SEGMENT
    sequences = [entry[1] for file in recordings(desk) for entry in index_of(file).entries]
    assert sequences == list(range(1, COUNT + 1))
    moments = [entry[2] for file in recordings(desk) for entry in index_of(file).entries]
    assert [later - one for one, later in zip(moments, moments[1:])] == [40_000_000] * (COUNT - 1)
    for file in recordings(desk):
        assert times(file)[0] == 0 and b"XDDX_START=" in file.read_bytes()[:200]


def test_files_are_prepared_ahead(desk: Desk, clip: pathlib.Path) -> None:
    saver = start(desk)
    pool = desk.folder / "rec/pool"

    def ready() -> int:
        found = [one.read_bytes() for one in pool.glob("*.index")]
        return sum(len(data) == 1 << 20 and HEADER.unpack_from(data)[1] == FREE for data in found)

    wait_until(lambda: ready() >= 2)
    files = {one.name for one in pool.glob("*.y4m")}
    assert desk.run("ddxvideoload", clip, "-readers", "1", "-rate", "3").returncode == 0
    stop(saver)
    assert files <= {one.name for one in pool.glob("*.y4m") if one.stat().st_nlink == 2}


def test_killed_recorders(desk: Desk, clip: pathlib.Path) -> None:
    """After the next start, all checkpointed frames are there, and missing ones are counted."""
    loader = desk.start("ddxvideoload", clip, "-loop")
    out = 0
    for _ in range(4):
        saver = start(desk)
        wait_until(lambda: "recording video" in desk.errors(saver))
        wait_until(lambda: desk.out("ddxvideosave") > out)
        out = desk.out("ddxvideosave")
        saver.send_signal(signal.SIGKILL)
        saver.wait()
    saver = start(desk)
    wait_until(lambda: "recording video" in desk.errors(saver))
    _, loaded = stop(loader)
    status, saved = stop(saver)
    assert status == 0
    assert check_files(desk, pictures(clip)) == saved["out"]
    assert saved["in"] == saved["out"] + lost(saved)
    assert saved["lost"]["restart"] > 0 and loaded["out"] >= saved["in"]


def stall(desk: Desk, clip: pathlib.Path, *options: object) -> tuple[Process, Process]:
    """A recorder frozen for longer than the store keeps frames, and the loader, which goes on."""
    saver = start(desk, "-keep", "8", *options)
    loader = desk.start("ddxvideoload", clip, "-loop", "-readers", "1", "-rate", "3")
    wait_until(lambda: desk.out("ddxvideosave") > 3)
    saver.send_signal(signal.SIGSTOP)
    begin = desk.out("ddxvideoload")
    wait_until(lambda: desk.out("ddxvideoload") > begin + 60)
    saver.send_signal(signal.SIGCONT)
    return saver, loader


def lose_frames(desk: Desk, clip: pathlib.Path) -> dict[str, int]:
    """Make a recording with lost frames in the middle; return its counters."""
    saver, loader = stall(desk, clip)
    before = desk.out("ddxvideosave")
    wait_until(lambda: desk.out("ddxvideosave") > before + 20)
    stop(loader)
    _, saved = stop(saver)
    assert lost(saved) > 40
    return saved


def test_losses_are_in_the_index(desk: Desk, clip: pathlib.Path) -> None:
    saved = lose_frames(desk, clip)
    indexes = [index_of(file) for file in recordings(desk)]
    assert sum(index.lost for index in indexes) == lost(saved)
    entries = [entry for index in indexes for entry in index.entries]
    assert len(entries) == saved["out"]
    for one, later in zip(entries, entries[1:]):
        assert later[1] - one[1] - 1 == later[8] + later[9]  # by the store's numbers


def test_a_deleted_recording_stays_deleted(desk: Desk, clip: pathlib.Path) -> None:
    """And its disk space is used again."""
    def record() -> None:
        saver = start(desk)
        assert desk.run("ddxvideoload", clip, "-readers", "1", "-rate", "3").returncode == 0
        assert stop(saver)[0] == 0

    record()
    deleted = [file.name for file in recordings(desk)]
    files = set((desk.folder / "rec/pool").glob("*.y4m"))
    for file in recordings(desk):
        file.unlink()
    record()
    assert not {file.name for file in recordings(desk)} & set(deleted)
    assert check_files(desk, pictures(clip)) == COUNT
    now = set((desk.folder / "rec/pool").glob("*.y4m"))
    assert files <= now and len(now) <= len(recordings(desk)) + 2  # two prepared files


@pytest.fixture(params=[("-t", "ext4", "-O", "^has_journal")])
def small_disk(desk: Desk, request: pytest.FixtureRequest) -> Iterator[pathlib.Path]:
    """64 MB of ext4 without a journal, as in the appliance."""
    image, folder = desk.folder / "disk.img", desk.folder / "rec"
    with image.open("wb") as file:
        file.truncate(64 << 20)
    subprocess.run(["mke2fs", "-q", *request.param, "-m", "0", image], check=True)
    folder.mkdir(exist_ok=True)
    if subprocess.run(["mount", "-o", "loop", image, folder], capture_output=True, check=False).returncode:
        pytest.skip("no loop mounts here")
    yield folder
    desk.end()
    subprocess.run(["umount", folder], check=True)


def test_a_full_disk_deletes_the_oldest_on_request(desk: Desk, small_disk: pathlib.Path) -> None:
    clip = make_clip(desk.folder / "clip.y4m", rate="50", frames=400)
    saver = start(desk, "-full", "recycle")
    assert desk.run("ddxvideoload", clip, "-readers", "1").returncode == 0
    status, saved = stop(saver)
    assert status == 0 and lost(saved) == 0 and saved["out"] == 400
    shown = [picture for file in recordings(desk) for picture in pictures(file)]
    assert 100 < len(shown) < 400 and shown == pictures(clip)[-len(shown):]
    assert min(int(file.name.split("-")[1]) for file in recordings(desk)) > 1


def test_a_full_disk_stops_the_recording_on_request(desk: Desk, small_disk: pathlib.Path) -> None:
    clip = make_clip(desk.folder / "clip.y4m", rate="50", frames=400)
    saver = start(desk, "-full", "stop")
    desk.run("ddxvideoload", clip, "-readers", "1")
    status, saved = stop(saver)
    assert status == 1 and "No space left" in desk.errors(saver)
    shown = [picture for file in recordings(desk) for picture in pictures(file)]
    assert shown == pictures(clip)[:len(shown)] and len(shown) == saved["out"] > 100
    assert saved["in"] == saved["out"] + lost(saved)


@pytest.mark.parametrize("small_disk", [("-t", "ext3")], indirect=True)
def test_a_file_system_that_cannot_reserve(desk: Desk, small_disk: pathlib.Path) -> None:
    """Files get their blocks as they are written, without a loss."""
    clip = make_clip(desk.folder / "clip.y4m", frames=COUNT)
    saver = start(desk)
    wait_until(lambda: len(list((small_disk / "pool").glob("*.index"))) >= 2)
    assert desk.run("ddxvideoload", clip, "-readers", "1").returncode == 0
    status, saved = stop(saver)
    assert status == 0 and lost(saved) == 0 and saved["out"] == COUNT
    assert "cannot be prepared" not in desk.errors(saver)
    assert check_files(desk, pictures(clip)) == COUNT


def test_two_recorders_share_a_pool(desk: Desk, clip: pathlib.Path) -> None:
    other = make_clip(desk.folder / "other.y4m", frames=COUNT, size="320x240")
    savers = [start(desk), start(desk, "-name", "rear", "-instance", "rear")]
    loaders = [desk.start("ddxvideoload", clip, "-readers", "1"),
               desk.start("ddxvideoload", other, "-readers", "1", "-name", "rear", "-instance", "load.rear")]
    for loader in loaders:
        assert loader.wait(60) == 0
    for saver in savers:
        status, saved = stop(saver)
        assert status == 0 and lost(saved) == 0 and saved["out"] == COUNT
    for name, source in (("video", clip), ("rear", other)):
        files = sorted((desk.folder / "rec").glob(f"{name}-*.y4m"))
        assert [picture for file in files for picture in pictures(file)] == pictures(source)
