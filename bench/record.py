# SPDX-License-Identifier: GPL-2.0-or-later
"""make test-long T=bench-record: are frames lost on slow and frozen disks? See docs/recording.md.

tools/bench record [-duration S] [-cases WORD,...]: in each case, a guest (1080p: the image's programs on this machine's
kernel) records onto its own disk; pictures, index and counters must agree. -duration: of the longest case. -cases: only
cases whose name has one of the words. Writes record.svg and, after each case, output/bench/record.jsonl: a stopped run
continues there, a run with another image starts over.
"""
import dataclasses
import json
import os
import pathlib
import platform
import time
from collections.abc import Iterable
from typing import Any

import numpy

import build
from bench import record_plot as bench_record_plot
from parts.common import MEMORY, OUTPUT, Failed, command_line, finish, say, scratch
from parts.guest import disk_session, machine, qemu, session, testdisk
from parts.guest.channel import Timeout
from parts.guest.disk_session import Result
from parts.guest.native_disk import NativeDisk
from parts.guest.native_machine import NativeMachine
from parts.guest.qemu import Guest
from parts.guest.slow_disk import SlowDisk, Speed
from parts.image import native
from parts.media import clip as default_clip
from parts.testing.campaign import Campaign

WORK = OUTPUT / "bench/record"
PICTURE = OUTPUT / "bench/record.svg"
SLOW, FAST = Speed(20, 100), Speed(110, 400)
FAULT_SECONDS = 30  # a fault shows soon
HD = (1920, 1080)
HD_FRAMES = 100     # of the looped clip
NONE, SOME, ANY = "none", "some", "any"
NAIVE, OURS = "naive", "ours"
SELDOM = 0.2        # Hz; about as often as the kernel commits the journal anyway


@dataclasses.dataclass(frozen=True)
class Case:
    name: str
    seconds: int
    lost: str = NONE          # frames that may or must be lost
    speed: Speed = SLOW
    file_system: str = "ext4"
    naive: bool = False
    cold: bool = False        # the recorder has prepared no file
    settings: str = ""        # of the recorder
    hertz: float = disk_session.HERTZ  # of the neighbour's fsync
    freeze: float = 0         # s
    every: float = 0          # s; 0: once, in the middle
    natively: bool = False    # 1080p on this machine's kernel: too much for an emulated processor
    limit: int = 4096         # MiB of the disk


# ---- The cases; beside each promise a case that must lose frames ----

def slow_disk(duration: int) -> list[Case]:
    return [Case("slow", duration), Case("slow first-start", min(duration, 30), cold=True),
            Case("slow ring-2", FAULT_SECONDS, SOME, settings="ring=2\n")]


def full_hd(duration: int) -> list[Case]:
    return [Case("1080p", min(duration, 60), speed=FAST, natively=True, limit=8192),
            Case("1080p half-speed", 30, SOME, speed=Speed(55, 200), natively=True, limit=8192)]


def frozen(duration: int) -> list[Case]:
    return [Case("frozen-2s", min(duration, 80), freeze=2, every=20),
            Case("frozen-2s ring-20", FAULT_SECONDS, SOME, settings="ring=20\n", freeze=2, every=20),
            Case("frozen-5s", FAULT_SECONDS, SOME, freeze=5)]


H264 = "format=h264\n"


def compressed(duration: int) -> list[Case]:
    """MP4 files: their ring holds the frames of many seconds."""
    return [Case("h264 slow", min(duration, 120), settings=H264),
            Case("h264 slow ring-2", FAULT_SECONDS, SOME, settings=H264 + "ring=2\nquality=0\n", freeze=5),
            Case("h264 frozen-2s", min(duration, 80), settings=H264, freeze=2, every=20),
            Case("h264 frozen-5s", FAULT_SECONDS, settings=H264, freeze=5),
            Case("h264 1080p", min(duration, 60), settings=H264, speed=FAST, natively=True, limit=8192)]


def comparison(duration: int) -> list[Case]:
    """As in the paper, where ext3's journal caused stalls. The rarer the calls of fsync, the more data each writes."""
    return [Case(f"{file_system} {writer}{often}", min(duration, 60),
                 ANY if writer == NAIVE else NONE, file_system=file_system, naive=writer == NAIVE, hertz=hertz)
            for often, hertz in (("", disk_session.HERTZ), (" seldom", SELDOM))
            for file_system in ("ext3", "ext4-journal", "ext4") for writer in (NAIVE, OURS)]


# ---- One case ----

def hd_clip(path: pathlib.Path) -> pathlib.Path:
    """Moving waves with frame numbers."""
    if path.exists():
        return path
    width, height = HD
    y, x = numpy.mgrid[0:height, 0:width]
    waves = (128 + 50 * numpy.sin(x / 17) + 40 * numpy.sin(y / 11)).astype(numpy.uint8)
    chroma = bytes([128]) * (width * height // 2)
    part = path.with_suffix(".part")
    with part.open("wb") as file:
        file.write(f"YUV4MPEG2 W{width} H{height} F{default_clip.RATE}:1 Ip A1:1 C420jpeg\n".encode())
        for number in range(HD_FRAMES):
            luma = numpy.roll(waves, 3 * number, axis=1)
            default_clip.draw_number(luma, number)
            file.write(b"FRAME\n" + luma.tobytes() + chroma)
    return part.rename(path)


def wait(case: Case, guest: Guest, disk: SlowDisk) -> None:
    """Let the case run for its time; freeze the disk when the case says so."""
    start = time.monotonic()
    freezes = ([case.every * (number + 0.5) for number in range(int(case.seconds / case.every))] if case.every else
               [case.seconds / 2] if case.freeze else [])
    told = 0.0
    while (now := time.monotonic() - start) < case.seconds:
        if freezes and now >= freezes[0]:
            disk.frozen(case.freeze)
            freezes.pop(0)
        elif now >= told + 30:
            told = now
            seen = session.follow(guest, now).get(session.SAVE)
            say(f"bench-record: {case.name}: {now:.0f} s" + (f", lost {seen.lost}" if seen else ""))
        time.sleep(0.2)


def run_natively(case: Case, root: pathlib.Path) -> Result:
    with scratch(MEMORY) as keep:
        for folder in ("test", "rec", "data/ddx"):
            (keep / folder).mkdir(parents=True)
        testdisk.fill(keep / "test", hd_clip(WORK / "hd.y4m"), disk_session.content(WORK, case.settings))
        for service in (session.LOAD, session.SAVE):
            (keep / f"data/ddx/{service}.conf").write_text("enabled=no\n")
        with NativeDisk(case.limit, keep / "rec", case.speed) as disk, NativeMachine(root, keep) as robot:
            disk_session.take_programs(robot)
            disk_session.begin_recorder(robot)
            disk_session.begin_clip(robot)
            time.sleep(case.seconds)
            return disk_session.end(robot, disk, frames=HD_FRAMES)


def run_case(case: Case, image: pathlib.Path, accel: str) -> Result:
    if case.natively:
        return run_natively(case, image.parent / "root")
    clip = WORK / "clip.y4m"
    if not clip.exists():
        default_clip.write(clip, disk_session.CLIP_SECONDS)
    test = disk_session.test_disk(WORK, clip, case.settings)
    with SlowDisk(case.limit, case.file_system) as disk, \
            Guest(image, accel, machine.machines(machine.DEV)[0], test_disk=test, provision=disk_session.QUIET,
                  extra=disk.drive(), log=WORK / "console.log") as guest:
        disk_session.prepare(guest, disk)
        disk_session.begin(guest, disk, case.speed, case.naive, case.cold, case.hertz)
        wait(case, guest, disk)
        return disk_session.end(guest, disk, case.naive)


def verdict(case: Case, result: Result) -> list[str]:
    """Reasons why the case failed."""
    found = result.found
    bad = list(found.disagreements)
    if found.wrong:
        bad.append(f"{found.wrong} pictures are not what the index says")
    if not found.recorded:
        bad.append("nothing was recorded")
    if case.lost == NONE and found.lost:
        bad.append(f"{found.lost} frames were lost, none should be")
    if case.lost == SOME and not found.lost:
        bad.append("no frame was lost, some should be: the case shows nothing")
    return bad


def row(case: Case, result: Result, load: float) -> dict[str, Any]:
    found = result.found
    return {"case": case.name, "seconds": case.seconds, "speed": dataclasses.asdict(case.speed),
            "file_system": case.file_system, "writer": NAIVE if case.naive else OURS, "settings": case.settings,
            "neighbour_hertz": case.hertz,
            "published": found.published, "recorded": found.recorded, "lost": found.lost,
            "lost_counted": {reason: count for reason, count in found.counted.items() if count},
            "longest_gap": found.longest, "stall_ms": result.stall_ms, "latency_us": result.save.latency,
            "fsyncs": result.neighbour,
            "host_load": round(load, 1), "wrong": verdict(case, result)}


# ---- All of them ----

def campaign(made_of: Iterable[pathlib.Path], duration: int) -> Campaign:
    return Campaign(WORK.parent / "record.jsonl", made_of, duration=duration, cores=len(os.sched_getaffinity(0)),
                    kernel=platform.release())


def main() -> int:
    options = command_line(__doc__, duration=600, cases="")
    WORK.mkdir(parents=True, exist_ok=True)
    cases = [case for some in (slow_disk, full_hd, frozen, compressed, comparison) for case in some(options.duration)
             if any(word in case.name for word in options.cases.split(","))]
    image = build.dev([native.build()])
    accel = qemu.acceleration(image)
    steps = campaign([image], options.duration)
    failed = False
    for case in cases:
        before = os.getloadavg()[0]
        try:
            if case.name not in steps.results:
                result = run_case(case, image, accel)
                steps.add(case.name, row(case, result, max(before, os.getloadavg()[0])))
                say(f"bench-record: {json.dumps(steps.results[case.name])}")
        except (Failed, Timeout) as error:
            failed = True  # the other cases run all the same
            say(f"bench-record: {case.name}: {error}")
    done = list(steps.results.values())
    PICTURE.write_text(bench_record_plot.picture(done))
    bad = [one for one in done if one["wrong"]]
    bench_record_plot.table(done)
    for one in bad:
        say(f"bench-record: {one['case']}: {'; '.join(one['wrong'])}")
    say(f"bench-record: {steps.file}, {PICTURE}")
    return 1 if bad or failed else 0


if __name__ == "__main__":
    finish("bench-record", main)
