# SPDX-License-Identifier: GPL-2.0-or-later
"""Programs of the desk build, each test with a store of its own."""
from __future__ import annotations

import functools
import json
import os
import pathlib
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from typing import Any

from parts.common import MORTAL

TOP = pathlib.Path(__file__).resolve().parents[2]
# Other builds are tested by naming their install tree, and what its users must be compiled with:
# DDX_ROOT=output/address/root/usr DDX_CFLAGS=-fsanitize=address,undefined
ROOT = pathlib.Path(os.environ.get("DDX_ROOT", TOP / "output/desk/root/usr"))

KEEP = 64  # frames that the store keeps for a recorder: most of a second where frames come fastest

Process = subprocess.Popen[str]
Counters = dict[str, Any]


def library_folder() -> pathlib.Path:
    return next(iter(sorted(ROOT.glob("lib/**/libddx.so")))).parent


class Desk:
    """A folder with its own store, and the programs that talk to it."""

    def __init__(self, folder: pathlib.Path, memory: str = "64M", store: str | pathlib.Path = "store") -> None:
        self.folder = folder
        self.environment = {**os.environ, "DDX_DIR": str(folder / "run"), "LD_LIBRARY_PATH": str(library_folder())}
        (folder / "run").mkdir()
        self.processes: list[Process] = []
        self.store = self.start(store, "-m", memory)
        wait_until(lambda: self.run("ddxctl", "list").returncode == 0)

    def start(self, program: str | pathlib.Path, *arguments: object, wrapper: tuple[str, ...] = ()) -> Process:
        command = [*MORTAL, *wrapper, str(ROOT / "bin" / program), *map(str, arguments)]
        errors = open(self.folder / f"errors-{len(self.processes)}", "w+")
        process = subprocess.Popen(command, env=self.environment, cwd=self.folder, stdout=subprocess.PIPE,
                                   stderr=errors, text=True)
        self.processes.append(process)
        return process

    def errors(self, process: Process) -> str:
        return (self.folder / f"errors-{self.processes.index(process)}").read_text()

    def run(self, program: str | pathlib.Path, *arguments: object,
            timeout: float = 60) -> subprocess.CompletedProcess[str]:
        return subprocess.run([*MORTAL, ROOT / "bin" / program, *map(str, arguments)], env=self.environment,
                              cwd=self.folder, capture_output=True, text=True, timeout=timeout)

    def stats(self, instance: str) -> Counters:
        """The counters of an instance, from the store. They are waited for: a program makes its item first, and writes
        the counters a moment later."""
        found: list[Counters] = []

        def look() -> bool:
            lines = self.run("ddxctl", "stats", "--json").stdout.splitlines()
            found.extend(counters for line in lines if (counters := json.loads(line))["instance"] == instance)
            return bool(found)

        wait_until(look)
        return dict(found[0])

    def out(self, instance: str) -> int:
        """Frames so far; none as long as it is not in the store."""
        lines = self.run("ddxctl", "stats", "--json").stdout.splitlines()
        return sum(int(counters["out"]) for line in lines if (counters := json.loads(line))["instance"] == instance)

    def item(self, name: str) -> dict[str, Any]:
        """What the store says of an item; nothing if there is no such item."""
        found = json.loads(self.run("ddxctl", "list", "--json").stdout)["items"]
        return next((dict(one) for one in found if one["name"] == name), {})

    def readers(self, item: str) -> int | None:
        """How many an item has; None if there is no such item."""
        return self.item(item).get("readers")

    def sequence(self, item: str) -> int:
        """Number of the newest value, without reading it; 0 if there is none."""
        return int(self.item(item).get("sequence", 0))

    def end(self) -> None:
        for process in reversed(self.processes):
            if process.poll() is None:
                process.terminate()
                process.send_signal(signal.SIGCONT)  # some are stopped
                try:
                    process.wait(5)
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.wait()
            if process.stdout:
                process.stdout.close()


def worker_of(store: Process) -> int:
    """The process that does the store's work; 0: there is none just now."""
    children = pathlib.Path(f"/proc/{store.pid}/task/{store.pid}/children").read_text().split()
    return int(children[0]) if children else 0


def send_signal(process: Process, number: int) -> None:
    """To a store's worker, too; the holder first, or it would see to another one."""
    process.send_signal(number)
    if worker := worker_of(process):
        os.kill(worker, number)


def stop(process: Process, number: int = signal.SIGTERM) -> tuple[int, Counters]:
    """End a program; its exit status, and its counters (empty if it printed none)."""
    process.send_signal(number)
    return result(process)


def result(process: Process) -> tuple[int, Counters]:
    out, _ = process.communicate(timeout=60)
    lines = out.splitlines()
    return process.returncode, json.loads(lines[-1]) if lines else {}


def lost(counters: Counters) -> int:
    return sum(counters["lost"].values())


def start_recorder(desk: Desk, *options: object, wrapper: tuple[str, ...] = ()) -> Process:
    """One that may come late, on a machine that has other things to do: the store keeps more frames for it."""
    return desk.start("ddxvideosave", "-keep", KEEP, *options, wrapper=wrapper)


def wait_for_recorder(desk: Desk, instance: str = "ddxvideosave") -> None:
    """Until it accounts for each frame that is written from now on, also of an item that does not exist yet."""
    def follows() -> bool:
        book = desk.run("ddxctl", "show", f"{instance}.stats", "--json").stdout
        return '"running":1' in book and '"follows":1' in book

    wait_until(follows)


def preload(name: str, folder: pathlib.Path) -> pathlib.Path:
    """One of the C files here, to be preloaded."""
    library = folder / f"{name}.so"
    subprocess.run(["gcc", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC",
                    pathlib.Path(__file__).with_name(f"{name}.c"), "-o", library], check=True)
    return library


def wait_until(condition: Callable[[], bool], seconds: float = 60) -> None:
    """The time is for a machine that hangs: no test passes or fails by it."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.02)


def record(desk: Desk, clip: pathlib.Path, output: pathlib.Path, *load: object, instance: str = "ddxvideosave",
           keep: int = KEEP) -> tuple[Counters, Counters]:
    """Play a clip and record it, from the first frame to the last; the counters of both."""
    saver = desk.start("ddxvideosave", "-output", output, "-instance", instance, "-keep", keep)
    loader = desk.run("ddxvideoload", clip, "-readers", "1", "-instance", f"load.{instance}", *load)
    assert loader.returncode == 0, loader.stderr
    status, saved = stop(saver)
    assert status == 0, desk.errors(saver)
    return json.loads(loader.stdout.splitlines()[-1]), saved


Y4M_BYTES = {"C422": 2, "C444": 3, "Cmono": 1, "Cmono16": 2}  # a pixel; of 4:2:0 1.5


def read_y4m(path: pathlib.Path) -> Iterator[tuple[str, bytes]]:
    """Header line and b"", then FRAME line and picture of each whole frame."""
    with open(path, "rb") as file:
        header = file.readline().decode().rstrip("\n")
        yield header, b""
        sides = {word[0]: int(word[1:]) for word in header.split()[1:] if word[0] in "WH"}
        tag = next((word for word in header.split() if word[0] == "C"), "C420")
        size = int(sides["W"] * sides["H"] * Y4M_BYTES.get(tag, 1.5))
        while line := file.readline():
            picture = file.read(size)
            if len(picture) == size:
                yield line.decode().rstrip("\n"), picture


def header_of(path: pathlib.Path) -> str:
    return next(read_y4m(path))[0]


def pictures(path: pathlib.Path) -> list[bytes]:
    return [picture for _, picture in read_y4m(path)][1:]


def times(path: pathlib.Path) -> list[int]:
    """XTIME of each frame."""
    words = [line.split() for line, picture in read_y4m(path) if picture]
    return [int(next(word for word in line if word.startswith("XTIME="))[6:]) for line in words]


def ffmpeg(*arguments: object) -> bytes:
    return subprocess.run(["ffmpeg", "-v", "error", "-nostdin", *map(str, arguments)], check=True,
                          stdout=subprocess.PIPE).stdout


def make_clip(path: pathlib.Path, size: str = "352x288", rate: str = "25", frames: int = 25, format: str = "yuv420p",
              *more: object) -> pathlib.Path:
    """A moving test picture, no frame like another."""
    path.write_bytes(picture_of(size, rate, frames, format, *more))
    return path


@functools.lru_cache(maxsize=4)
def picture_of(size: str, rate: str, frames: int, format: str, *more: object) -> bytes:
    return ffmpeg("-f", "lavfi", "-i", f"testsrc2=size={size}:rate={rate}", "-frames:v", frames, "-pix_fmt", format,
                  *more, "-strict", "-1", "-f", "yuv4mpegpipe", "-")


def frame_md5(path: pathlib.Path) -> list[str]:
    """FFmpeg's own opinion about the frames of a file."""
    lines = ffmpeg("-i", path, "-f", "framemd5", "-").decode().splitlines()
    return [line.split(",")[-1].strip() for line in lines if not line.startswith("#")]


class Compiler:
    """Builds a C program of the tests against what is installed, as a user would."""

    def __init__(self, folder: pathlib.Path) -> None:
        self.folder = folder

    def __call__(self, name: str, *libraries: str) -> pathlib.Path:
        program = self.folder / name
        if not program.exists():
            flags = os.environ.get("DDX_CFLAGS", "").split()
            subprocess.run(["gcc", "-std=gnu11", "-Wall", "-Wextra", "-Werror", *flags, f"-I{ROOT}/include",
                            pathlib.Path(__file__).with_name(f"{name}.c"), "-o", program, f"-L{library_folder()}",
                            *(f"-l{library}" for library in libraries), "-lddx"], check=True)
        return program
