#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""make run: a clip through the appliance, frame by frame.

usage: run.py [CLIP.y4m]        BOARD=name chooses the board, FIRMWARE=bios|uefi and ACCEL=tcg|kvm how QEMU runs it

Boots the image (without BOARD the development image), injects the clip, shows a line a second, compares the recording
with the clip, writes output/report.json. Exit status 1 if a frame was lost or the programs' counters are wrong.
"""
import json
import os
import pathlib
import sys
import time

import build
import clip as default_clip
import machine
import native
import qemu
import session
import terminal
import testdisk
import y4m
from common import OUTPUT, TOP, Failed, say
from counters import Counters
from disk import digest
from session import LOAD, SAVE

REPORT = OUTPUT / "report.json"
WORK = OUTPUT / "run"
LARGEST = 480 * 10**6  # bytes; see rec.ext4 in board/common/disk.cfg


def show(seconds: float, seen: dict[str, Counters]) -> None:
    load, save = seen.get(LOAD, Counters()), seen.get(SAVE, Counters())
    lost = {**{f"load.{k}": v for k, v in load.lost.items() if v}, **{k: v for k, v in save.lost.items() if v}}
    words = " ".join(f"{reason} {count}" for reason, count in lost.items()) or "none"

    def latency(counts: Counters) -> str:
        return "/".join(str(counts.latency.get(key, 0)) for key in ("p50", "p99", "max"))

    say(f"{seconds:4.0f} s  in {load.frames_in:5}  stored {load.out:5}  recorded {save.out:5}  lost: {words}  "
        f"latency µs p50/p99/max  store {latency(load)}  record {latency(save)}")


def report(result: session.Result, image: pathlib.Path, accel: str) -> dict[str, object]:
    return {
        "frames": {"in": result.outside.clip, "stored": result.load.out, "recorded": result.outside.recorded},
        "lost": {"store": result.lost_store, "record": result.lost_record},
        "latency_us": {"store": result.load.latency, "record": result.save.latency},
        "boot": {"kernel_to_first_frame_s": round(result.load.first_ns / 1e9, 3)},
        "image": str(image.relative_to(TOP)),
        "accel": accel.split(",")[0],
        "disagreements": result.disagreements,
    }


def table(result: session.Result) -> None:
    outside = result.outside
    say("")
    say(f"{'stage':8} {'frames':>8} {'lost':>6} {'p50 µs':>9} {'p99 µs':>9} {'max µs':>9}")
    say(f"{'clip':8} {outside.clip:8}")
    for name, frames, lost, counts in [("store", result.load.out, result.lost_store, result.load),
                                       ("record", outside.recorded, result.lost_record, result.save)]:
        times = " ".join(f"{counts.latency.get(key, 0):9}" for key in ("p50", "p99", "max"))
        say(f"{name:8} {frames:8} {lost:6} {times}")
    say("")
    if outside.missing:
        say(f"missing in the recording: {', '.join(map(str, outside.missing[:20]))}"
            f"{' ...' if len(outside.missing) > 20 else ''}")
    for text in result.disagreements:
        say(f"counters disagree: {text}")
    how = "byte for byte" if outside.exact else "counted only, since its pictures were converted to 4:2:0"
    say(f"{outside.recorded} of {outside.clip} frames recorded, in order, compared with the clip {how}; "
        f"first frame {result.load.first_ns / 1e9:.1f} s after the kernel's start")


def main() -> int:
    begin = time.monotonic()
    board = machine.machines(os.environ.get("BOARD") or machine.DEV)[0]
    development = build.dev([native.build()])
    image = development if board.board == machine.DEV else machine.image(board.board)
    WORK.mkdir(parents=True, exist_ok=True)
    if len(sys.argv) > 1 and sys.argv[1]:
        clip = pathlib.Path(sys.argv[1]).resolve()
    else:
        clip = OUTPUT / "clip.y4m"
        if not clip.exists():
            say("drawing the clip ...")
            default_clip.write(clip.with_suffix(".new"))
            clip.with_suffix(".new").rename(clip)
    header, frames = y4m.read(clip)
    if clip.stat().st_size > LARGEST:
        raise Failed(f"{clip.name} is larger than {LARGEST // 10**6} MB, the recording partition of this image")
    count = sum(1 for _ in frames)
    rate = [int(word) for word in (header.value("F") or "25:1").split(":")]
    disk = testdisk.make(WORK / "test.img", clip)
    accel = qemu.acceleration(development)
    say(f"booting {image.relative_to(TOP)} ({board.firmware}, {accel}), "
        f"console log in {(WORK / 'console.log').relative_to(TOP)} ...")
    flashed = digest(image)
    with qemu.Guest(image, accel, board, test_disk=disk, memory=testdisk.memory(clip),
                    log=WORK / "console.log") as guest:
        guest.shell("hvc0")
        say(f"up after {time.monotonic() - guest.begin:.1f} s; {clip.name}: {count} frames")
        session.wait_for_clip(guest, count, show, rate[0] / rate[1])
        session.stop_recorder(guest)
        result = session.collect(guest, clip, WORK / "recorded.y4m")
        table(result)
        REPORT.write_text(json.dumps(report(result, image, accel), indent=2) + "\n")
        say(f"{REPORT.relative_to(TOP)}; {time.monotonic() - begin:.0f} s in all")
        if sys.stdin.isatty() and sys.stdout.isatty():
            guest.sh("mount -o remount,rw /rec && /etc/init.d/S*ddxvideosave start")
            terminal.attach(guest.channel("ttyS0"))
        else:
            guest.poweroff()
    if digest(image) != flashed:
        raise Failed(f"{image.relative_to(TOP)} was changed by the run")
    return 0 if result.good else 1


if __name__ == "__main__":
    try:
        sys.exit(main())
    except (Failed, y4m.Malformed, FileNotFoundError) as error:
        say(f"run: {error}")
        sys.exit(1)
    except KeyboardInterrupt:
        sys.exit(130)
