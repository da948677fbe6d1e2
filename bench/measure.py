# SPDX-License-Identifier: GPL-2.0-or-later
"""Measuring: a slice runs the writer and readers of one peer in one case for about a second, see bench/main.c."""
import dataclasses
import itertools
import json
import os
import pathlib
import select
import statistics
import subprocess
import time
from collections.abc import Iterable
from typing import Any

from parts.common import MORTAL, OUTPUT, TOP, Failed, say
from parts.image import native
from parts.processes import Client

BUILD = OUTPUT / "bench/build"
BEFORE = OUTPUT / "bench/before"  # the store of another commit, which is the peer of that name
PATIENCE = 30  # s that a program may take to print a line
PEERS = ["ddx", "futex", "iceoryx2", "gstreamer", "lcm"]
NO_ZERO_COPY = ["lcm"]
SIZES = {"cif": 352 * 288 * 3 // 2, "1080p": 1920 * 1080 * 3 // 2, "640x480": 640 * 480 * 3 // 2}


@dataclasses.dataclass(frozen=True)
class Case:
    name: str
    bytes: int
    readers: int
    mode: str  # zerocopy, copy or direct
    interval: int  # us
    frames: int
    peers: tuple[str, ...]
    writers: int = 1


@dataclasses.dataclass
class Slice:
    """The figures of a slice; times in us, CPU per frame written and per frame delivered."""
    latency: list[float]
    writer_cpu: float
    reader_cpu: float
    percent: float  # of one core: all processes together
    lost: int
    torn: int
    queued: float  # ms that writers and readers waited for a core

    @property
    def p50(self) -> float:
        return percentile(self.latency, 50)


def percentile(values: Iterable[float], part: float) -> float:
    """The smallest value that is not less than `part` per cent of the values."""
    ordered = sorted(values)
    return ordered[max(0, -(-int(part * len(ordered)) // 100) - 1)] if ordered else float("nan")


def save(name: str, figures: object) -> pathlib.Path:
    """Write output/bench/<name>.json."""
    path = OUTPUT / f"bench/{name}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(figures, indent=1) + "\n")
    say(f"bench: {path.relative_to(TOP)}")
    return path


def cases() -> list[Case]:
    found = []
    for size, interval, frames in (("cif", 5000, 150), ("1080p", 10000, 80)):
        for readers in (1, 8):
            zero = tuple(peer for peer in PEERS if peer not in NO_ZERO_COPY)
            found.append(Case(f"{size}-1x{readers}-zerocopy", SIZES[size], readers, "zerocopy", interval, frames, zero))
            if (size, readers) == ("1080p", 1):
                found.append(Case("direct", SIZES[size], readers, "direct", interval, frames, ("ddx",)))
            found.append(Case(f"{size}-1x{readers}-copy", SIZES[size], readers, "copy", interval, frames, tuple(PEERS)))
    found.append(Case("5x640x480-30fps-3readers", SIZES["640x480"], 3, "zerocopy", 33333, 60, zero, writers=5))
    return found


def place(peer: str) -> tuple[pathlib.Path, pathlib.Path]:
    """The install tree of the peer's store and library, and its program."""
    if peer == "before":
        return BEFORE / "root", BEFORE / "build/bench-ddx"
    return OUTPUT / "desk/root", BUILD / f"bench-{peer}"


class Party(Client):
    """A writer or a reader, started and ready."""

    def __init__(self, peer: str, folder: pathlib.Path, **options: object) -> None:
        root, program = place(peer)
        environment = {**os.environ, **native.environment(root), "DDX_DIR": str(folder)}
        words = [f"{key.replace('_', '-')}={value}" for key, value in options.items()]
        self.name = " ".join([str(program), *words[:2]])
        super().__init__([program, *words], cwd=folder, env=environment)

    def ready(self) -> None:
        if self.line() != "ready":
            raise Failed(f"{self.name}: cannot start")

    def line(self) -> str:
        assert self.process.stdout
        if not select.select([self.process.stdout], [], [], PATIENCE)[0]:
            self.process.kill()
            raise Failed(f"{self.name}: hangs")
        return super().line()

    def result(self) -> dict[str, Any]:
        try:
            return dict(json.loads(self.line()))
        except ValueError:
            raise Failed(f"{self.name}: failed") from None

    def end(self) -> None:
        try:
            self.process.communicate(timeout=5)  # it exits when its standard input is closed
        except subprocess.TimeoutExpired:
            super().end()


class Store:
    """The store for ddx in its own folder; its CPU time is part of the total."""

    def __init__(self, folder: pathlib.Path, peer: str = "ddx", memory: str = "256M") -> None:
        root = place(peer)[0]
        self.process = subprocess.Popen([*MORTAL, root / "usr/bin/ddxstore", "-m", memory], stderr=subprocess.DEVNULL,
                                        env={**os.environ, **native.environment(root), "DDX_DIR": str(folder)})
        os.sched_setaffinity(self.process.pid, cpus()[-1:])

    def cpu(self) -> float:
        """ns"""
        return float(pathlib.Path(f"/proc/{self.process.pid}/schedstat").read_text().split()[0])

    def end(self) -> None:
        self.process.terminate()
        self.process.wait(10)


def cpus() -> list[int]:
    return sorted(os.sched_getaffinity(0))


class Starved(Failed):
    """A reader took fewer than two frames, and the slice's programs waited for a core for most of the time."""


names = (f"bench-{os.getpid()}-{number}" for number in itertools.count())


def run_slice(case: Case, peer: str, folder: pathlib.Path, store: Store, warm_up: int = 10,
              **faults: object) -> Slice:
    """Run a slice: writers begin with the first core, readers with the core after their writer's, all in turn."""
    core = cpus()
    writers: list[Party] = []
    readers: list[Party] = []
    try:
        for camera in range(case.writers):
            options = {"mode": case.mode, "name": next(names), "bytes": case.bytes, "readers": case.readers,
                       "frames": case.frames, "warm_up": warm_up, "interval": case.interval}
            writers.append(Party(peer, folder, role="writer", cpu=core[camera % len(core)], **options, **faults))
            writers[-1].ready()
            readers += [Party(peer, folder, role="reader", cpu=core[(camera + 1 + number) % len(core)], **options)
                        for number in range(case.readers)]
        for program in readers:
            program.ready()
        for program in readers:
            program.say("go")
        time.sleep(0.05)  # until the readers sleep in their first wait
        store_before = store.cpu()
        begin = time.monotonic()
        for program in writers:
            program.say("go")
        wrote = [program.result() for program in writers]
        seconds = time.monotonic() - begin
        store_cpu = store.cpu() - store_before if peer in ("ddx", "before") else 0
        read = [program.result() for program in readers]
    finally:
        for program in [*writers, *readers]:
            program.end()
    reader_cpu = [found["cpu_ns"] / (found["frames"] - 1) / 1000 for found in read if found["frames"] > 1]
    queued = sum(found["queued_ns"] for found in wrote + read) / 1e6
    if not reader_cpu:
        raise (Starved if queued > seconds * 1000 / 2 else Failed)(
            f"{peer}: {case.name}: of {case.frames} frames, {max(found['frames'] for found in read)} arrive; "
            f"waited {queued:.0f} ms of {seconds * 1000:.0f} ms for a core")
    writer_cpu = statistics.mean(found["cpu_ns"] / found["frames"] / 1000 for found in wrote)
    total = writer_cpu * case.writers + sum(reader_cpu)
    return Slice(latency=[ns / 1000 for found in read for ns in found["latency_ns"]], writer_cpu=writer_cpu,
                 reader_cpu=statistics.mean(reader_cpu),
                 percent=100 * (total / case.interval + store_cpu / 1e9 / seconds),
                 lost=sum(found["lost"] for found in read), torn=sum(found["torn"] for found in read),
                 queued=queued)
