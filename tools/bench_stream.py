#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""The stream's part of make bench: from a frame that is ready to its decoded pixels, and what the sender costs.

bench_stream.py [-rounds N] in a network of its own. Prints a table, writes output/bench/stream.json. A round is 15 s of
the real clip at CIF 25 for each codec, and as much of the sender's encoder alone (bench/encode.c); the figures come
from the pictures' numbers, the store's times and the kernel's CPU accounting, not from what the programs say.
"""
from __future__ import annotations

import argparse
import json
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time
from typing import Any

import numpy

from parts.bench.measure import cpus, percentile
from parts.common import MORTAL, OUTPUT, TOP, Failed, finish, say
from parts.image import native
from parts.media.clip import draw_number, frame_number
from parts.media.footage import footage

SIZE = 352, 288
RATE, SECONDS, WARM_UP = 25, 15, 2
BITRATE = 200
LIMIT_P50_MS, LIMIT_SENDER_PERCENT = 2.0, 2.0
CODECS = ["h264", "mpeg4"]
CLIP = OUTPUT / "bench/stream.y4m"
ENCODE = OUTPUT / "desk/ddxvideo/stream/encode"


def numbered_clip() -> pathlib.Path:
    """The real clip with a number in each picture."""
    if CLIP.exists():
        return CLIP
    CLIP.parent.mkdir(parents=True, exist_ok=True)
    frames = SECONDS * RATE
    plain = footage(CLIP.with_suffix(".plain.y4m"), frames, f"{SIZE[0]}x{SIZE[1]}")
    luma = SIZE[0] * SIZE[1]
    with plain.open("rb") as source, CLIP.with_suffix(".new").open("wb") as target:
        target.write(source.readline())
        for number in range(frames):
            target.write(source.readline())
            plane = numpy.frombuffer(source.read(luma), numpy.uint8).reshape(SIZE[1], SIZE[0]).copy()
            draw_number(plane, number)
            target.write(plane.tobytes() + source.read(luma // 2))
    plain.unlink()
    CLIP.with_suffix(".new").rename(CLIP)
    return CLIP


class Programs:
    """A store and what talks to it, in a folder; ended together."""

    def __init__(self, folder: pathlib.Path) -> None:
        root = OUTPUT / "desk/root"
        self.folder = folder
        self.bin = root / "usr/bin"
        self.environment = {**os.environ, **native.environment(root), "DDX_DIR": str(folder)}
        self.running: list[subprocess.Popen[bytes]] = []
        self.start("store", "-m", "64M")

    def start(self, name: str, *words: str) -> subprocess.Popen[bytes]:
        process = subprocess.Popen([self.bin / name, *words], env=self.environment, stdout=subprocess.DEVNULL,
                                   stderr=subprocess.DEVNULL, cwd=self.folder)
        self.running.append(process)
        return process

    def end(self) -> None:
        for process in reversed(self.running):
            process.terminate()
            process.wait(10)


def cpu_seconds(process: subprocess.Popen[bytes]) -> float:
    """Of all its threads, ended ones included."""
    fields = pathlib.Path(f"/proc/{process.pid}/stat").read_text().rsplit(")", 1)[1].split()
    tasks = pathlib.Path(f"/proc/{process.pid}/task").iterdir()
    exact = sum(float((task / "schedstat").read_text().split()[0]) for task in tasks) / 1e9
    ticks = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    return max(exact, ticks)


def watch(item: str, seconds: float) -> None:
    """In a process of its own: a JSON list of [number in the picture, when it was there, time of the write]."""
    import ddx  # found by PYTHONPATH
    found = []
    deadline = time.monotonic() + seconds
    with ddx.Store() as store:
        while time.monotonic() < deadline:
            try:
                with store.item(item) as video:
                    for frame in video.frames(timeout=1.0):
                        number = frame_number(frame["y"].tobytes(), *SIZE)
                        found.append([number, time.monotonic_ns(), frame.time])
            except (ddx.Error, TimeoutError):
                time.sleep(0.01)
    print(json.dumps(found))


def slice_of(codec: str, folder: pathlib.Path) -> dict[str, Any]:
    programs = Programs(folder)
    me = [sys.executable, "-B", __file__, "-watch"]
    environment = {**programs.environment, "PYTHONPATH": f"{TOP}/package/ddx/python:{TOP}/tools"}
    try:
        decode = programs.start("decode", "-headless", "-name", "seen")
        sender = programs.start("ddxvideosend", "-codec", codec, "-bitrate", str(BITRATE))
        watchers = [subprocess.Popen([*me, item, str(SECONDS)], env=environment, stdout=subprocess.PIPE, text=True)
                    for item in ("video", "seen")]
        time.sleep(1)
        loader = programs.start("ddxvideoload", str(CLIP), "-readers", "2")
        time.sleep(WARM_UP)
        before, begin = cpu_seconds(sender), time.monotonic()
        decode_before = cpu_seconds(decode)
        time.sleep(SECONDS - WARM_UP - 2)
        seconds = time.monotonic() - begin
        sender_percent = 100 * (cpu_seconds(sender) - before) / seconds
        decode_percent = 100 * (cpu_seconds(decode) - decode_before) / seconds
        loader.wait(30)
        video, seen = (json.loads(watcher.communicate(timeout=60)[0]) for watcher in watchers)
    finally:
        programs.end()
    ready = {number: written for number, _, written in video if number is not None}
    latency = [(written - ready[number]) / 1e6 for number, _, written in seen if number in ready]
    if len(latency) < SECONDS * RATE / 2:
        raise Failed(f"{codec}: only {len(latency)} frames arrived")
    return {"codec": codec, "latency_ms": latency, "sender_percent": sender_percent, "decode_percent": decode_percent}


def alone(codec: str) -> float:
    """The encoder without a sender: percent of a core, for as long as the sender was measured."""
    encoder = subprocess.Popen([*MORTAL, ENCODE, CLIP, codec, str(BITRATE)])
    try:
        time.sleep(WARM_UP)
        before, begin = cpu_seconds(encoder), time.monotonic()
        time.sleep(SECONDS - WARM_UP - 2)
        if encoder.poll() is not None:
            raise Failed(f"{ENCODE.name} ended with status {encoder.returncode}")
        return 100 * (cpu_seconds(encoder) - before) / (time.monotonic() - begin)
    finally:
        encoder.kill()
        encoder.wait()


def report(slices: list[dict[str, Any]]) -> list[dict[str, Any]]:
    rows = []
    for codec in CODECS:
        mine = [one for one in slices if one["codec"] == codec]
        latency = [value for one in mine for value in one["latency_ms"]]
        rows.append({"codec": codec, "frames": len(latency), "p50_ms": round(percentile(latency, 50), 2),
                     "p99_ms": round(percentile(latency, 99), 2), "max_ms": round(max(latency), 2),
                     "sender_percent": round(statistics.median(one["sender_percent"] for one in mine), 2),
                     "encoder_percent": round(statistics.median(one["encoder_percent"] for one in mine), 2),
                     "sender_ratio": round(statistics.median(one["sender_percent"] / one["encoder_percent"]
                                                             for one in mine), 2),
                     "decode_percent": round(statistics.median(one["decode_percent"] for one in mine), 2)})
    return rows


def table(rows: list[dict[str, Any]]) -> None:
    heads = [("p50", "ms"), ("p99", "ms"), ("sender", "CPU %"), ("encoder", "CPU %"), ("ratio", ""),
             ("decode", "CPU %")]
    for line, title in enumerate((f"stream, CIF 25, {BITRATE} kbit/s", "")):
        say(f"{title:34}" + "".join(f"{head[line]:>9}" for head in heads))
    for row in rows:
        over = [what for what, value, limit in (("p50", row["p50_ms"], LIMIT_P50_MS),
                                                 ("sender", row["sender_percent"], LIMIT_SENDER_PERCENT))
                if value > limit]
        say(f"{row['codec']:34}{row['p50_ms']:9.2f}{row['p99_ms']:9.2f}{row['sender_percent']:9.2f}"
            f"{row['encoder_percent']:9.2f}{row['sender_ratio']:9.2f}{row['decode_percent']:9.2f}"
            + (f"   over the limit: {', '.join(over)}" if over else ""))


def measure(rounds: int) -> list[dict[str, Any]]:
    """In a network where multicast goes over the loopback."""
    numbered_clip()
    slices = []
    for _ in range(rounds):
        for codec in CODECS:
            with tempfile.TemporaryDirectory(prefix="ddx-bench-") as name:
                slices.append({**slice_of(codec, pathlib.Path(name)), "encoder_percent": alone(codec)})
    rows = report(slices)
    table(rows)
    (OUTPUT / "bench/stream.json").write_text(json.dumps({"cores": len(cpus()), "stream": rows}, indent=1) + "\n")
    return rows


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("-rounds", type=int, default=2)
    parser.add_argument("-watch", nargs=2, metavar=("ITEM", "SECONDS"), help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.watch:
        watch(options.watch[0], float(options.watch[1]))
        return 0
    from bench import own_network
    if not os.environ.get("DDX_BENCH_INSIDE"):
        native.build()
        numbered_clip()
    own_network()
    measure(options.rounds)
    return 0


if __name__ == "__main__":
    finish("bench", main)
