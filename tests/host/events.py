# SPDX-License-Identifier: GPL-2.0-or-later
"""Random events, drawn from a seed, on a real writer and recorder; then the files are compared with the counters.

The files are read frame by frame, by code that shares nothing with the programs: each byte of a picture holds its
number. Odd seeds record lossless MP4 files, which FFmpeg decodes.
"""
from __future__ import annotations

import json
import os
import pathlib
import random
import shutil
import signal
import struct
import subprocess
import time
from collections.abc import Callable
from typing import Any

from parts.media import mp4

from .programs import Desk, Process, wait_until

SIZES = ((64, 48), (48, 32))
FRAMES = 1000
RATE = 200


def picture(number: int, width: int, height: int) -> bytes:
    luma, chroma = width * height, width * height // 4
    return struct.pack("<I", number) * (luma // 4) + bytes((number % 251,)) * chroma + bytes((number % 241,)) * chroma


def write_clips(folder: pathlib.Path) -> list[pathlib.Path]:
    clips = []
    for width, height in SIZES:
        clip = folder / f"{width}.y4m"
        clip.write_bytes(f"YUV4MPEG2 W{width} H{height} F{RATE}:1 Ip A1:1 C420mpeg2\n".encode() +
                         b"".join(b"FRAME\n" + picture(number, width, height) for number in range(FRAMES)))
        clips.append(clip)
    return clips


def read_coded(path: pathlib.Path) -> list[int]:
    width, height = mp4.size(path)
    found = [(struct.unpack_from("<I", one)[0], one) for one in mp4.pictures(path, width * height * 3 // 2)]
    assert all(one == picture(number, width, height) for number, one in found), f"{path}: torn frame"
    return [number for number, _ in found]


def read_numbers(path: pathlib.Path) -> list[int]:
    """The numbers of the frames in a recording; anything else in it, or a partial frame, is an error."""
    if path.suffix == ".mp4":
        return read_coded(path)
    data = path.read_bytes()
    end = data.index(b"\n")
    words = {word[:1]: word[1:] for word in data[:end].split()[1:]}
    width, height = int(words[b"W"]), int(words[b"H"])
    size, at, numbers = width * height * 3 // 2, end + 1, []
    while at < len(data):
        line = data.index(b"\n", at)
        assert data[at:line].startswith(b"FRAME"), f"{path}: no frame at byte {at}"
        found = data[line + 1:line + 1 + size]
        assert len(found) == size, f"{path}: ends within a frame"
        number = struct.unpack_from("<I", found)[0]
        assert found == picture(number, width, height), f"{path}: torn frame {number}"
        numbers.append(number)
        at = line + 1 + size
    return numbers


class Script:
    """The events of one seed. `disk`: the folder to record into; `room`: whether it can be filled up."""

    def __init__(self, seed: int, desk: Desk, clips: list[pathlib.Path], disk: pathlib.Path, room: bool) -> None:
        self.random = random.Random(seed)
        self.desk, self.clips, self.disk, self.room = desk, clips, disk, room
        self.kept = desk.folder / "kept"  # files saved before the disk was unplugged
        self.kept.mkdir()
        self.folder = disk / "rec"
        self.folder.mkdir(exist_ok=True)
        self.format = ("-format", "h264", "-quality", "0") if seed % 2 else ()
        self.suffix = ".mp4" if seed % 2 else ".y4m"
        self.output = self.folder if self.random.random() < 0.6 else self.folder / f"out{self.suffix}"
        self.filler = disk / "filler"
        self.recorder: Process | None = None
        self.writer: Process | None = None
        self.frozen: set[int] = set()
        self.size = 0
        self.unwanted = 0  # frames written while no recorder was requested
        self.starts = 0
        self.log: list[str] = []

    # ---- Observations ----

    def note(self, text: str) -> None:
        self.log.append(f"{self.desk.sequence('video')}: {text}")

    def counters(self, instance: str) -> dict[str, Any]:
        shown = self.desk.run("ddxctl", "show", f"{instance}.stats", "--json").stdout
        return dict(json.loads(shown)["value"]) if shown else {}

    def alive(self, process: Process | None) -> bool:
        return process is not None and process.poll() is None

    def wait_for_frames(self, frames: int) -> None:
        """Wait until that many frames are written, if there is a writer."""
        begin = self.desk.sequence("video")
        if self.writer is not None and self.alive(self.writer) and self.writer.pid not in self.frozen:
            wait_until(lambda: not self.alive(self.writer) or self.desk.sequence("video") >= begin + frames)

    # ---- Events ----

    def freeze(self, process: Process | None) -> None:
        if process is not None and self.alive(process):
            process.send_signal(signal.SIGSTOP)
            pid = process.pid
            wait_until(lambda: not self.alive(process) or stopped(pid))  # it may have been about to exit
            if self.alive(process):
                self.frozen.add(pid)

    def thaw(self, process: Process | None) -> None:
        if process is not None and process.pid in self.frozen:
            process.send_signal(signal.SIGCONT)
            self.frozen.discard(process.pid)

    def kill(self, process: Process | None) -> None:
        if process is not None and self.alive(process):
            process.kill()
            process.wait()
            self.frozen.discard(process.pid)

    def start_writer(self) -> None:
        if not self.alive(self.writer):
            # The writer does not wait for a recorder: a recorder that starts late misses frames, and must count them.
            self.writer = self.desk.start("ddxvideoload", self.clips[self.size], "-loop")
            begin = self.desk.sequence("video")
            wait_until(lambda: not self.alive(self.writer) or self.desk.sequence("video") > begin)

    def stop_writer(self) -> None:
        if self.writer is not None and self.alive(self.writer):
            self.thaw(self.writer)
            self.writer.terminate()
            assert self.writer.wait(60) == 0

    def start_recorder(self) -> None:
        if self.alive(self.recorder):
            return
        starts = int(self.counters("ddxvideosave").get("starts", 0))
        self.recorder = self.desk.start("ddxvideosave", "-output", self.output, *self.format, "-keep",
                                        self.random.choice((4, 32)))
        wait_until(lambda: not self.alive(self.recorder) or self.follows(starts))

    def follows(self, starts: int) -> bool:
        found = self.counters("ddxvideosave")
        return bool(found and found["starts"] > starts and found["running"] and found.get("follows", 1))

    def stop_recorder(self) -> None:
        """Stop the recorder on request: frames written until its next start need not be counted."""
        if self.recorder is None or not self.alive(self.recorder) or self.filler.exists():
            return
        self.freeze(self.writer)
        self.thaw(self.recorder)
        self.recorder.terminate()
        status = self.recorder.wait(60)
        before = self.desk.sequence("video")
        if not self.output.is_dir():
            self.save_files(set())  # a named file is overwritten by a new recording
        if status == 0 and self.random.random() < 0.5:
            self.thaw(self.writer)
            self.wait_for_frames(5)
            self.freeze(self.writer)
            self.unwanted += self.desk.sequence("video") - before
        self.start_recorder()
        self.thaw(self.writer)

    def fill(self) -> None:
        if self.room and not self.filler.exists():
            self.thaw(self.recorder)
            with self.filler.open("wb", buffering=0) as file:
                try:
                    while True:
                        file.write(bytes(1 << 16))
                except OSError:
                    pass

    def free(self) -> None:
        self.filler.unlink(missing_ok=True)

    def save_files(self, but: set[str]) -> None:
        for file in sorted(self.folder.glob(f"*{self.suffix}")):
            if str(file) not in but:
                shutil.move(file, self.kept / f"{len(list(self.kept.iterdir()))}{self.suffix}")

    def unplug(self) -> None:
        """Remove the folder with the current recording; finished files have been saved before."""
        self.start_recorder()  # completes the files of a killed recorder while they exist
        self.freeze(self.recorder)
        open_now = opened(self.recorder.pid) if self.recorder is not None and self.alive(self.recorder) else set()
        self.save_files(open_now)
        shutil.rmtree(self.folder)
        self.folder.mkdir()
        self.thaw(self.recorder)
        if any(name.startswith(f"{self.folder}/") for name in open_now):  # the folder itself is open only for reading
            # The recorder notices within a second. If it were killed before, its file would look like a moved one.
            assert self.recorder is not None and self.recorder.wait(60) == 1

    def change_size(self) -> None:
        self.stop_writer()
        self.size = 1 - self.size
        self.start_writer()

    def run(self) -> None:
        events: dict[str, Callable[[], None]] = {
            "start": self.start_recorder, "stop": self.stop_recorder, "kill": lambda: self.kill(self.recorder),
            "freeze": lambda: self.freeze(self.recorder), "thaw": lambda: self.thaw(self.recorder),
            "full": self.fill, "free": self.free, "unplug": self.unplug, "size": self.change_size,
            "writer starts": self.start_writer, "writer killed": lambda: self.kill(self.writer),
            "writer frozen": lambda: self.freeze(self.writer), "writer thawed": lambda: self.thaw(self.writer)}
        for first in self.random.sample((self.start_recorder, self.start_writer), 2):
            if first == self.start_recorder and self.writer is not None:
                self.freeze(self.writer)
                self.unwanted += self.desk.sequence("video")  # before a recorder was requested
            first()
            self.thaw(self.writer)
        for _ in range(self.random.randint(4, 9)):
            name = self.random.choice(list(events))
            self.note(name)
            events[name]()
            self.wait_for_frames(self.random.choice((0, 1, 3, 10, 30)))
        self.finish()

    def finish(self) -> None:
        """Continue all programs, then stop them."""
        self.note("finish")
        self.free()
        self.thaw(self.recorder)
        self.start_writer()
        self.thaw(self.writer)
        for _ in range(3):  # one may be about to notice a full or removed disk
            self.start_recorder()
            self.wait_for_frames(3)
        self.stop_writer()
        written = self.desk.sequence("video")
        wait_until(lambda: self.caught_up(written))
        assert self.recorder is not None
        self.recorder.terminate()
        self.recorder.wait(60)

    def caught_up(self, written: int) -> bool:
        """Whether the recorder has counted all frames; false if it failed again: the next one counts them."""
        self.start_recorder()
        return int(self.counters("ddxvideosave")["sequence"]) >= written

    # ---- The sums ----

    def judge(self) -> None:
        written = self.desk.sequence("video")
        files = [*self.folder.glob(f"*{self.suffix}"), *self.kept.iterdir()]
        numbers = [read_numbers(file) for file in files if file.stat().st_size]
        loaded, saved = self.desk.stats("ddxvideoload"), self.desk.stats("ddxvideosave")
        in_files = sum(map(len, numbers))
        lost = {name: frames for name, frames in saved["lost"].items() if frames}
        story = "\n".join([*self.log, f"written {written}, unwanted {self.unwanted}, in files {in_files}",
                           f"writer {loaded}", f"recorder {saved}",
                           *(path.read_text() for path in sorted(self.desk.folder.glob("errors-*")))])
        assert loaded["out"] == written and loaded["in"] == written + sum(loaded["lost"].values()), story
        assert saved["out"] == in_files, f"{saved['out']} counted as recorded, {in_files} are: {story}"
        assert written - self.unwanted == in_files + sum(lost.values()), story
        assert saved["in"] == written - self.unwanted and not saved["waiting"], story
        assert set(lost) <= {"store", "ring", "write", "restart"}, story
        for one in numbers:  # in order, except where a writer restarted
            assert all(b > a or b < 200 for a, b in zip(one, one[1:])), story


def stopped(pid: int) -> bool:
    try:
        return "State:\tT" in pathlib.Path(f"/proc/{pid}/status").read_text()
    except FileNotFoundError:
        return True


def opened(pid: int) -> set[str]:
    found = set()
    for link in pathlib.Path(f"/proc/{pid}/fd").iterdir():
        try:
            found.add(os.readlink(link))
        except OSError:
            pass
    return found


def play(seed: int, folder: pathlib.Path, clips: list[pathlib.Path]) -> None:
    """Run one seed in its own folder."""
    home = folder / str(seed)
    disk = home / "disk"
    disk.mkdir(parents=True)
    room = not subprocess.run(["mount", "-t", "tmpfs", "-o", "size=8m", "none", disk], capture_output=True).returncode
    desk = Desk(home, "16M")
    begin = time.monotonic()
    try:
        script = Script(seed, desk, clips, disk, room)
        try:
            script.run()
            script.judge()
        except Exception as error:
            raise AssertionError(f"seed {seed}: {error}\n" + "\n".join(script.log)) from error
    finally:
        for process in desk.processes:
            if process.poll() is None:
                process.send_signal(signal.SIGCONT)
        desk.end()
        if room:
            subprocess.run(["umount", "-l", disk], check=True)
    shutil.rmtree(home)
    print(f"seed {seed}: {time.monotonic() - begin:.1f} s")
