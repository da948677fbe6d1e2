#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""make run: send a clip through the appliance, and account for each frame.

usage: run.py [CLIP.y4m]        SOURCE=clip|vivid: how the clip comes in, BOARD=name: which image is booted,
                                FIRMWARE=bios|uefi, ACCEL=tcg|kvm: how QEMU runs it

Boots the image (without BOARD the development image), replays the clip or shows it to a camera (vivid), records and
streams it at the same time and prints a line a second. Compares the recording with the clip, and the receiver's
pictures with the recording; writes output/report.json and output/report.html. Exit status 1 if the recording lacks a
frame or the programs' counters are wrong. The stream may lose frames, since nothing waits for it, but counts them.
"""
import os
import pathlib
import sys
import time

import build
from parts.common import OUTPUT, TOP, BadInput, Failed, finish, say
from parts.disk.disk import digest
from parts.guest import machine, qemu, session, source, stream, terminal
from parts.guest.session import SAVE
from parts.guest.stream import DECODE, RECORDER, SEND
from parts.media import clip as default_clip, y4m
from parts.media.counters import Counters
from parts.media.recording import Comparison
from parts.media.report import About, Report, Stage, page
from parts.release.version import parse

REPORT, PAGE = OUTPUT / "report.json", OUTPUT / "report.html"
WORK = OUTPUT / "run"
LARGEST = 240 * 10**6  # bytes, so that both recordings fit; see rec.ext4 in board/common/disk.cfg
CAMERA_SECONDS = 12    # of the clip for a camera, which is shown slowly, for a minute


class Follower:
    """Prints a line a second, and keeps the counters for the page."""

    def __init__(self, grabber: str) -> None:
        self.names = {"stored": grabber, "recorded": SAVE, "sent": SEND, "decoded": DECODE}
        self.seconds: list[tuple[float, dict[str, int]]] = []

    def __call__(self, seconds: float, seen: dict[str, Counters]) -> None:
        now = {stage: seen.get(name, Counters()) for stage, name in self.names.items()}
        self.seconds.append((seconds, {stage: counts.out for stage, counts in now.items()}))
        lost = " ".join(f"{stage}.{reason} {count}" for stage, counts in now.items()
                        for reason, count in counts.lost.items() if count) or "none"
        frames = "  ".join(f"{stage} {counts.out:5}" for stage, counts in now.items())
        times = " ".join(f"{now[stage].latency.get('p50', 0) / 1000:.1f}"
                         for stage in ("stored", "recorded", "decoded"))
        say(f"{seconds:4.0f} s  {frames}  p50 {times} ms  lost: {lost}")


def table(report: Report) -> None:
    say("")
    say(f"{'stage':9} {'frames':>8} {'lost':>6} {'p50 µs':>9} {'p99 µs':>9} {'max µs':>9}")
    say(f"{'in':9} {report.frames_in:8}")
    for one in report.stages:
        times = " ".join(f"{one.counters.latency.get(key, 0):9}" for key in ("p50", "p99", "max"))
        say(f"{one.name:9} {one.frames:8} {one.lost:6} {times}")
    say("")
    for text in report.notes:
        say(text)
    for text in report.disagreements:
        say(f"counters disagree: {text}")


def drawn_clip(seconds: int) -> pathlib.Path:
    OUTPUT.mkdir(exist_ok=True)
    path = OUTPUT / ("clip.y4m" if seconds == default_clip.SECONDS else f"clip-{seconds}.y4m")
    if not path.exists():
        say("drawing the clip ...")
        default_clip.write(path.with_suffix(".new"), seconds)
        path.with_suffix(".new").rename(path)
    return path


def listed(numbers: list[int]) -> str:
    return ", ".join(map(str, numbers[:20])) + (" ..." if len(numbers) > 20 else "")


def remarks(clip: str, outside: Comparison, seen: stream.Result, accel: str) -> list[str]:
    """How the frames were compared, and remarks about the result."""
    how = "byte for byte" if outside.exact else "by count, since they were converted to 4:2:0"
    notes = [f"{outside.recorded} of {outside.clip} frames were recorded, in order, compared with {clip} {how}."]
    if outside.missing:
        notes.append(f"Missing in the recording: {listed(outside.missing)}")
    if seen.likeness:
        notes.append(seen.likeness.words())
    if seen.missing:
        notes.append(f"Not in the stream: frames {listed(seen.missing)}. The sender takes the newest frame, so others "
                     "are lost while it encodes one for longer than the time to the next; its slowest frame took "
                     f"{seen.sent.latency.get('max', 0) / 1000:.0f} ms.")
    if accel == "tcg":
        notes.append("QEMU emulated the processor (no KVM): a real machine has shorter latencies.")
    return notes


def collect(guest: qemu.Guest, origin: source.Clip | source.Vivid, follower: Follower,
            about: About) -> tuple[session.Result, Report]:
    """After all programs have stopped: extract both recordings without the guest, and judge them and the counters."""
    books = {stage: session.histogram(guest, name) for stage, name in follower.names.items()}
    recorded, shown = WORK / "recorded.y4m", WORK / "shown.y4m"
    ends = stream.collect(guest, origin.grabber, recorded, shown)
    result = origin.judge(recorded, ends[origin.grabber], ends[SAVE])
    seen = stream.judge(shown, recorded, ends[SEND], ends[DECODE], ends[RECORDER])
    stages = [Stage("stored", result.load.out - result.before, result.lost_store, result.load, books["stored"]),
              Stage("recorded", result.outside.recorded, result.lost_record, result.save, books["recorded"]),
              Stage("sent", seen.sent.out, seen.lost_send, seen.sent, books["sent"]),
              Stage("decoded", seen.decoded.out, seen.lost_decode, seen.decoded, books["decoded"])]
    about.boot = {"kernel_to_first_frame_s": round(result.load.first_ns / 1e9, 3)}
    about.stream = seen.likeness.figures() if seen.likeness else {"compared_by": "number"}
    notes = remarks(origin.clip.name, result.outside, seen, about.accel)
    disagreements = result.disagreements + seen.disagreements
    if seen.wrong:
        disagreements.append(f"{len(seen.wrong)} pictures that {DECODE} showed are not those of their time")
    passed = result.good and not disagreements
    return result, Report(result.outside.clip, stages, about, disagreements, follower.seconds, passed, notes)


def main() -> int:
    begin = time.monotonic()
    board = machine.machines(os.environ.get("BOARD") or machine.DEV)[0]
    kind = os.environ.get("SOURCE") or "clip"
    if kind not in source.SOURCES:
        say(f"run: SOURCE={kind}: there are {' and '.join(source.SOURCES)}")
        return 2
    if board.board != machine.DEV:
        machine.image(board.board)  # fails if there is none
    if len(sys.argv) > 1 and sys.argv[1]:
        clip = pathlib.Path(sys.argv[1]).resolve()
    else:
        clip = drawn_clip(default_clip.SECONDS if kind == "clip" else CAMERA_SECONDS)
    if not clip.is_file():
        raise BadInput(f"CLIP={sys.argv[1]}: no such file")
    origin = source.SOURCES[kind](clip)
    if clip.stat().st_size > LARGEST:
        raise BadInput(f"{clip.name} is larger than {LARGEST // 10**6} MB, half the recording partition of this image")
    development = build.for_run()
    image = development if board.board == machine.DEV else machine.image(board.board)
    WORK.mkdir(parents=True, exist_ok=True)
    accel = qemu.acceleration(development)
    disk = origin.disk(WORK, board.board, stream.settings(accel))
    say(f"booting {image.relative_to(TOP)} ({board.firmware}, {accel}), "
        f"console log in {(WORK / 'console.log').relative_to(TOP)} ...")
    flashed = digest(image)
    follower = Follower(origin.grabber)
    with qemu.Guest(image, accel, board, test_disk=disk, more_memory=origin.more_memory, log=WORK / "console.log",
                    serial=True, size=origin.size and image.stat().st_size + origin.size) as guest:
        guest.shell("hvc0")
        say(f"up after {time.monotonic() - guest.begin:.1f} s; {clip.name}: {origin.frames} frames")
        origin.play(guest, follower)
        stream.stop(guest)
        session.stop_recorder(guest)
        version = parse(guest.sh("cat /etc/os-release"))["VERSION"]
        about = About(version, kind, str(image.relative_to(TOP)), accel.split(",")[0])
        result, report = collect(guest, origin, follower, about)
        table(report)
        REPORT.write_text(report.json())
        PAGE.write_text(page(report))
        say(f"first frame {result.load.first_ns / 1e9:.1f} s after the kernel's start")
        say(f"{REPORT.relative_to(TOP)}, {PAGE.relative_to(TOP)}; {time.monotonic() - begin:.0f} s in all")
        if sys.stdin.isatty() and sys.stdout.isatty():
            guest.sh("mount -o remount,rw /rec")
            guest.sh(f"for name in {SAVE} {DECODE} {SEND}; do /etc/init.d/S*$name start; done")
            if kind == "clip":
                say(f"`ddxctl restart {origin.grabber}` plays the clip again")
            terminal.attach(guest.channel("ttyS0"))
        else:
            guest.poweroff()
    if digest(image) != flashed:
        raise Failed(f"{image.relative_to(TOP)} was changed by the run")
    return 0 if report.passed else 1


def checked() -> int:
    try:
        return main()
    except y4m.Malformed as error:
        raise BadInput(str(error)) from None


if __name__ == "__main__":
    finish("run", checked)
