# SPDX-License-Identifier: GPL-2.0-or-later
"""Recordings can be listed, verified and exported."""
from __future__ import annotations

import json
import os
import pathlib
import re
import signal
import subprocess
from collections.abc import Iterator
from typing import Any

import pytest

from .programs import Desk, lost, pictures, preload, start_recorder, stop, wait_until
from .test_pool import COUNT, FREE, HEADER, clip, index_of, lose_frames, recordings, start

pytestmark = pytest.mark.strict

LONG = "ddxrecordings"
__all__ = ["clip"]  # a fixture


@pytest.fixture
def recorded(desk: Desk, clip: pathlib.Path) -> list[pathlib.Path]:
    record(desk, clip)
    return recordings(desk)


def record(desk: Desk, clip: pathlib.Path) -> None:
    saver = start(desk)
    assert desk.run("ddxvideoload", clip, "-readers", "1", "-rate", "3").returncode == 0
    status, saved = stop(saver)
    assert status == 0 and lost(saved) == 0


def listed(desk: Desk) -> list[dict[str, Any]]:
    done = desk.run(LONG, "list", "-json", "-folder", "rec")
    assert done.returncode == 0 and done.stderr == ""
    return [json.loads(line) for line in done.stdout.splitlines()]


def run(desk: Desk, *words: object) -> subprocess.CompletedProcess[str]:
    return desk.run(LONG, *words, "-folder", "rec")


def flip(file: pathlib.Path, at: int) -> None:
    with file.open("r+b") as data:
        data.seek(at)
        byte = data.read(1)[0]
        data.seek(at)
        data.write(bytes([byte ^ 1]))


def test_list_matches_the_files(desk: Desk, clip: pathlib.Path, recorded: list[pathlib.Path]) -> None:
    record(desk, clip)
    both = recordings(desk)
    first, second = listed(desk)
    assert [first["recording"], second["recording"]] == ["video-000001", f"video-{len(recorded) + 1:06}"]
    assert first["files"] == [file.name for file in recorded] and len(first["files"]) > 1
    assert second["files"] == [file.name for file in both if file not in recorded]
    for one in first, second:
        files = [desk.folder / "rec" / name for name in one["files"]]
        assert one["frames"] == sum(len(pictures(file)) for file in files) == COUNT
        assert one["bytes"] == sum(file.stat().st_size for file in files)
        assert one["state"] == "finished" and sum(one["lost"].values()) == 0 and one["item"] == "video"
        assert abs(one["seconds"] - COUNT / 75) < 0.2
    assert first["utc"] <= second["utc"]
    table = run(desk, "list").stdout.splitlines()
    assert len(table) == 4 and table[1].split()[0] == "video-000001" and table[1].split()[-2:] == ["0", "finished"]
    room = re.match(r"room for (\d+) MB .*; (\d+) MB of it in prepared files, (\d+) MB free; files ready: ",
                    table[3])
    assert room and int(room[1]) <= int(room[2]) + int(room[3]) + 1  # each number is rounded down


def test_list_marks_running_and_recovered_recordings(desk: Desk, clip: pathlib.Path) -> None:
    loader = desk.start("ddxvideoload", clip, "-loop", "-rate", "0.2")  # slow enough for one file
    saver = start(desk)
    wait_until(lambda: any(one["frames"] > 5 for one in listed(desk)))
    now, = listed(desk)
    assert now["state"] == "recording" and now["frames"] <= desk.out("ddxvideosave")
    assert run(desk, "verify").returncode == 0  # frames checkpointed so far
    saver.send_signal(signal.SIGKILL)
    saver.wait()
    assert listed(desk)[0]["state"] == "interrupted"
    assert desk.run("ddxvideosave", "-output", "rec", "-segment", "4", "-recover").returncode == 0
    stop(loader)
    after, = listed(desk)
    assert after["state"] == "recovered" and after["frames"] >= now["frames"]
    assert after["frames"] == sum(len(pictures(file)) for file in recordings(desk))


def test_a_recording_is_unfinished_between_two_of_its_files(desk: Desk, clip: pathlib.Path) -> None:
    saver = start(desk)
    loader = desk.start("ddxvideoload", clip, "-loop")
    wait_until(lambda: len(listed(desk)) > 0)
    states = set()
    while len((now := listed(desk)[0])["files"]) < 6:
        states.add(now["state"])
    stop(loader)
    assert stop(saver)[0] == 0
    assert states == {"recording"} and [one["state"] for one in listed(desk)] == ["finished"]


def test_losses_are_those_of_the_recorder(desk: Desk, clip: pathlib.Path) -> None:
    saved = lose_frames(desk, clip)
    assert sum(one["lost"]["store"] + one["lost"]["ring"] for one in listed(desk)) == lost(saved)


def test_without_an_index(desk: Desk, clip: pathlib.Path) -> None:
    rec = desk.folder / "rec"
    saver = start_recorder(desk, "-output", "rec")
    assert desk.run("ddxvideoload", clip, "-readers", "1").returncode == 0
    stop(saver)
    plain, = recordings(desk)
    (rec / "cut.y4m").write_bytes(plain.read_bytes()[:-1000])
    (rec / "notes.y4m").write_text("no video")
    cut, whole = listed(desk)
    assert cut["recording"] == "cut.y4m" and cut["frames"] == COUNT - 1 and cut["state"] == "cut off"
    assert whole["files"] == [plain.name] and whole["frames"] == COUNT and whole["lost"] is None
    assert whole["bytes"] == plain.stat().st_size and abs(whole["seconds"] - COUNT / 25) < 0.2
    assert run(desk, "verify", plain.name).returncode == 0
    bad = run(desk, "verify")
    assert bad.returncode == 1 and f"cut.y4m: after {COUNT - 1} whole frames" in bad.stderr


def test_a_file_s_name_cannot_control_the_terminal(desk: Desk, clip: pathlib.Path, tmp_path: pathlib.Path) -> None:
    """The recorder's user can choose any file name, which root then lists, verifies and copies."""
    stick = tmp_path / "stick"
    stick.mkdir()
    for name in ("\x1b]0;evil\x07-000007-20260101T000000Z.y4m", "two\nlines\x7f.y4m", "cut\x1b[2J-000008-x.y4m"):
        (desk.folder / "rec" / name).write_bytes(clip.read_bytes()[:-1 if "cut" in name else None])
    commands: list[tuple[str, ...]] = [("list",), ("verify",), ("export", "all", str(stick))]
    for words in commands:
        done = run(desk, *words)
        said = done.stdout + done.stderr
        assert [c for c in said if not c.isprintable() and c != "\n"] == [], words
        assert "two?lines?.y4m" in said and "?]0;evil?" in said, words
    assert {file.name for file in stick.iterdir()} == {file.name for file in (desk.folder / "rec").iterdir()}


def test_one_flipped_bit_is_found_and_its_frame_named(desk: Desk, recorded: list[pathlib.Path]) -> None:
    good = run(desk, "verify")
    assert good.returncode == 0 and good.stderr == ""
    assert good.stdout.splitlines() == [f"{file.name}: good, {len(pictures(file))} frames" for file in recorded]
    entry = index_of(recorded[1]).entries[7]
    flip(recorded[1], entry[3] + entry[4] - 1)  # its last byte
    bad = run(desk, "verify")
    said = f"{recorded[1].name}: frame 7 is not what was recorded (number {entry[1]} of the item)"
    assert (bad.returncode, bad.stderr) == (1, f"ddxrecordings: {said}\n")
    assert len(bad.stdout.splitlines()) == len(recorded) - 1
    assert run(desk, "verify", recorded[0].name).returncode == 0
    assert run(desk, "verify", "video-000001").returncode == run(desk, "verify", "1").returncode == 1
    flip(recorded[1], entry[3])
    assert "frame 7 is" in run(desk, "verify", "1").stderr
    for number in 8, 9, 20:
        flip(recorded[1], index_of(recorded[1]).entries[number][3] + 100)
    assert "4 frames are not what was recorded, the first is frame 7" in run(desk, "verify").stderr


def test_a_truncated_file_and_a_damaged_index_are_found(desk: Desk, recorded: list[pathlib.Path]) -> None:
    inode = recorded[0].stat().st_ino
    with recorded[0].open("r+b") as file:
        file.truncate(index_of(recorded[0]).entries[10][3] + 5)
    frames = index_of(recorded[0]).frames
    assert f"frames 10 to {frames - 1} are not what was recorded" in run(desk, "verify").stderr
    pool = desk.folder / "rec/pool"
    other = next(one for one in pool.glob("*.y4m") if one.stat().st_ino == recorded[1].stat().st_ino != inode)
    flip(other.with_suffix(".index"), 4096 + 64 * 3 + 9)
    bad = run(desk, "verify", recorded[1].name)
    assert bad.returncode == 1 and "its index is damaged: 3 of" in bad.stderr


@pytest.fixture
def stick(tmp_path: pathlib.Path) -> Iterator[pathlib.Path]:
    """32 MB."""
    image, folder = tmp_path / "stick.img", tmp_path / "stick"
    subprocess.run(["mke2fs", "-q", "-t", "ext4", "-O", "^has_journal", "-m", "0", image, "32M"], check=True)
    folder.mkdir()
    if subprocess.run(["mount", "-o", "loop", image, folder], capture_output=True, check=False).returncode:
        pytest.skip("no loop mounts here")
    yield folder
    subprocess.run(["umount", folder], check=True)


def same(folder: pathlib.Path, files: list[pathlib.Path]) -> None:
    """Check that the folder has exactly these files, byte for byte."""
    assert sorted(one.name for one in folder.iterdir()) == sorted(file.name for file in files)
    for file in files:
        assert (folder / file.name).read_bytes() == file.read_bytes()


def test_export(desk: Desk, recorded: list[pathlib.Path], tmp_path: pathlib.Path) -> None:
    (tmp_path / "to").mkdir()
    (tmp_path / "to" / recorded[0].name).write_text("older")  # will be replaced
    done = run(desk, "export", "newest", tmp_path / "to")
    assert done.returncode == 0 and done.stderr == ""
    assert done.stdout.splitlines()[-1].endswith(f"MB, {len(recorded)} of {len(recorded)}")
    same(tmp_path / "to", recorded)


def test_a_full_stick_is_refused_before_anything_is_written(desk: Desk, recorded: list[pathlib.Path],
                                                            stick: pathlib.Path) -> None:
    (stick / "other").write_bytes(bytes(20 << 20))
    done = run(desk, "export", "all", stick)
    assert done.returncode == 1 and len(done.stderr.splitlines()) == 1 and "nothing was copied" in done.stderr
    assert sorted(one.name for one in stick.iterdir()) == ["lost+found", "other"]
    assert run(desk, "export", recorded[0].name, stick).returncode == 0


def test_damaged_files_are_exported_and_named(desk: Desk, recorded: list[pathlib.Path], tmp_path: pathlib.Path) -> None:
    flip(recorded[0], index_of(recorded[0]).entries[3][3] + 50)
    (tmp_path / "to").mkdir()
    done = run(desk, "export", "1", tmp_path / "to")
    assert done.returncode == 1 and f"{recorded[0].name}: frame 3 is not what was recorded" in done.stderr
    same(tmp_path / "to", recorded)


def test_export_while_recording_takes_finished_files(desk: Desk, clip: pathlib.Path, tmp_path: pathlib.Path) -> None:
    (tmp_path / "to").mkdir()
    saver = start(desk)
    loader = desk.start("ddxvideoload", clip, "-loop", "-readers", "1")
    wait_until(lambda: len(recordings(desk)) > 3)
    wait_until(lambda: bool(listed(desk)[0]["state"] == "recording"))
    done = run(desk, "export", "all", tmp_path / "to")
    assert done.returncode == 0 and "is not finished, left out" in done.stderr
    copies = sorted((tmp_path / "to").iterdir())
    assert len(copies) > 3
    stop(loader)
    _, saved = stop(saver)
    assert saved["in"] == saved["out"] and lost(saved) == 0
    same(tmp_path / "to", [desk.folder / "rec" / file.name for file in copies])


PLANTED = ("pipe", "link", "other file")


def plant(name: pathlib.Path, what: str, secret: pathlib.Path) -> None:
    """Replace a file, as the user who owns the folder can."""
    name.unlink(missing_ok=True)
    if what == "pipe":
        os.mkfifo(name)
    elif what == "link":
        name.symlink_to(secret)
    else:
        name.hardlink_to(secret)


def test_an_export_reads_back_the_file_that_it_wrote(desk: Desk, recorded: list[pathlib.Path],
                                                     tmp_path: pathlib.Path) -> None:
    folder, secret, waits = tmp_path / "to", tmp_path / "secret", tmp_path / "waits"
    folder.mkdir()
    secret.write_bytes(recorded[0].read_bytes())  # same bytes, so that the checksum does not reveal it
    wrapper = ("env", f"LD_PRELOAD={preload('stalled_disk', tmp_path)}", f"STALLED_FSYNC={waits}")
    part = folder / f"{recorded[0].name}.part"
    for what in PLANTED:
        waits.touch()
        export = desk.start(LONG, "export", recorded[0].name, folder, "-folder", "rec", wrapper=wrapper)
        wait_until(lambda: part.exists() and part.stat().st_size == secret.stat().st_size)
        plant(part, what, secret)
        waits.unlink()
        assert export.wait(20) == 1 and "reads back as something else" in desk.errors(export), what
        assert list(folder.iterdir()) == []


def test_an_export_writes_a_new_file(desk: Desk, recorded: list[pathlib.Path], tmp_path: pathlib.Path) -> None:
    folder, secret = tmp_path / "to", tmp_path / "secret"
    folder.mkdir()
    secret.write_text("root's own\n")
    for what in PLANTED:
        plant(folder / f"{recorded[0].name}.part", what, secret)
        export = desk.start(LONG, "export", recorded[0].name, folder, "-folder", "rec")
        assert export.wait(20) == 0 and secret.read_text() == "root's own\n", what
        same(folder, recorded[:1])


def test_list_opens_no_pipe_and_follows_no_link(desk: Desk, recorded: list[pathlib.Path]) -> None:
    ready, secret = "files ready: 1\n", desk.folder / "secret"
    assert ready in run(desk, "list").stdout
    # A file that was being prepared when the recorder stopped has an index, too, but is not ready.
    index = next(one for one in (desk.folder / "rec/pool").glob("*.index")
                 if one.stat().st_size == 1 << 20 and HEADER.unpack_from(one.read_bytes())[1] == FREE)
    index.rename(secret)
    for what in ("pipe", "link"):
        plant(index, what, secret)
        listing = desk.start(LONG, "list", "-folder", "rec")
        assert listing.wait(20) == 0 and ready not in listing.communicate()[0], what


@pytest.mark.parametrize("words, status, says", [
    ([], 2, "usage: "),
    (["show"], 2, "show: unknown command"),
    (["list", "x"], 2, "takes no names"),
    (["export", "all"], 2, "needs names"),
    (["verify", "-fast"], 2, "-fast: unknown option"),
    (["verify", "video-000099"], 2, "video-000099: there is no such recording"),
    (["export", "99", "."], 2, "99: there is no such recording"),
    (["export", "all", "nowhere"], 2, "all: there is no such recording"),
])
def test_wrong_words(desk: Desk, words: list[str], status: int, says: str) -> None:
    (desk.folder / "rec").mkdir()
    done = run(desk, *words)
    assert done.returncode == status and says in done.stderr and done.stdout == ""
