# SPDX-License-Identifier: GPL-2.0-or-later
"""Programs of the desk build; each test has its own store."""
from __future__ import annotations

import functools
import json
import os
import pathlib
import signal
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from parts.common import MORTAL

TOP = pathlib.Path(__file__).resolve().parents[2]
# To test another build, name its install tree and the compiler flags of its users:
# DDX_ROOT=output/address/root/usr DDX_CFLAGS=-fsanitize=address,undefined
ROOT = pathlib.Path(os.environ.get("DDX_ROOT", TOP / "output/desk/root/usr"))

KEEP = 64  # frames that the store keeps for a recorder: most of a second at the highest rate

Process = subprocess.Popen[str]
Counters = dict[str, Any]


def library_folder() -> pathlib.Path:
    return next(iter(sorted(ROOT.glob("lib/**/libddx.so")))).parent


class Desk:
    """A folder with its own store, and the programs that use it."""

    def __init__(self, folder: pathlib.Path, memory: str = "64M", store: str | pathlib.Path = "ddxstore") -> None:
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
        """Wait for the counters of an instance in the store: a program creates the item before it writes them."""
        found: list[Counters] = []

        def look() -> bool:
            lines = self.run("ddxctl", "stats", "--json").stdout.splitlines()
            found.extend(counters for line in lines if (counters := json.loads(line))["instance"] == instance)
            return bool(found)

        wait_until(look)
        return dict(found[0])

    def out(self, instance: str) -> int:
        """The frames put out so far; 0 while the counters are not in the store."""
        lines = self.run("ddxctl", "stats", "--json").stdout.splitlines()
        return sum(int(counters["out"]) for line in lines if (counters := json.loads(line))["instance"] == instance)

    def item(self, name: str) -> dict[str, Any]:
        """The store's information on an item; empty without such an item."""
        found = json.loads(self.run("ddxctl", "list", "--json").stdout)["items"]
        return next((dict(one) for one in found if one["name"] == name), {})

    def readers(self, item: str) -> int | None:
        """The number of an item's readers; None without such an item."""
        return self.item(item).get("readers")

    def sequence(self, item: str) -> int:
        """The number of the newest value, without reading it; 0 without a value."""
        return int(self.item(item).get("sequence", 0))

    def end(self) -> None:
        for process in reversed(self.processes):
            if process.poll() is None:
                process.terminate()
                process.send_signal(signal.SIGCONT)  # some are frozen
                try:
                    process.wait(5)
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.wait()
            if process.stdout:
                process.stdout.close()


def worker_of(store: Process) -> int:
    """The process of the store's worker; 0 if there is none now."""
    children = pathlib.Path(f"/proc/{store.pid}/task/{store.pid}/children").read_text().split()
    return int(children[0]) if children else 0


def send_signal(process: Process, number: int) -> None:
    """Signal a program; for a store, its holder before its worker, which the holder would otherwise replace."""
    process.send_signal(number)
    if worker := worker_of(process):
        os.kill(worker, number)


def stop(process: Process, number: int = signal.SIGTERM) -> tuple[int, Counters]:
    """Stop a program; return its exit status and counters (empty if it printed none)."""
    process.send_signal(number)
    return result(process)


def result(process: Process) -> tuple[int, Counters]:
    out, _ = process.communicate(timeout=60)
    lines = out.splitlines()
    return process.returncode, json.loads(lines[-1]) if lines else {}


def lost(counters: Counters) -> int:
    return sum(counters["lost"].values())


def start_recorder(desk: Desk, *options: object, wrapper: tuple[str, ...] = ()) -> Process:
    """Start a recorder for which the store keeps more frames, since a busy machine may delay it."""
    return desk.start("ddxvideosave", "-keep", KEEP, *options, wrapper=wrapper)


def wait_for_recorder(desk: Desk, instance: str = "ddxvideosave", starts: int = 1) -> None:
    """Wait until it accounts for each frame written from now on, also of an item that does not exist yet.

    The counters of a recorder that was killed say that it runs and follows: after a kill, give the number of the start.
    """
    def follows() -> bool:
        text = desk.run("ddxctl", "show", f"{instance}.stats", "--json").stdout
        return '"running":1' in text and '"follows":1' in text and json.loads(text)["value"]["starts"] >= starts

    wait_until(follows)


def preload(name: str, folder: pathlib.Path) -> pathlib.Path:
    """Compile one of the C files here for LD_PRELOAD."""
    library = folder / f"{name}.so"
    subprocess.run(["gcc", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC",
                    pathlib.Path(__file__).with_name(f"{name}.c"), "-o", library], check=True)
    return library


def wait_until(condition: Callable[[], bool], seconds: float = 60) -> None:
    """Wait for the condition; the limit only stops a test that hangs."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "timed out waiting for a condition"
        time.sleep(0.02)


def record(desk: Desk, clip: pathlib.Path, output: pathlib.Path, *load: object, instance: str = "ddxvideosave",
           keep: int = KEEP) -> tuple[Counters, Counters]:
    """Play a clip and record all of it; return the counters of both programs."""
    saver = desk.start("ddxvideosave", "-output", output, "-instance", instance, "-keep", keep)
    loader = desk.run("ddxvideoload", clip, "-readers", "1", "-instance", f"load.{instance}", *load)
    assert loader.returncode == 0, loader.stderr
    status, saved = stop(saver)
    assert status == 0, desk.errors(saver)
    return json.loads(loader.stdout.splitlines()[-1]), saved


Y4M_BYTES = {"C422": 2, "C444": 3, "Cmono": 1, "Cmono16": 2}  # per pixel; 4:2:0 has 1.5


def read_y4m(path: pathlib.Path) -> Iterator[tuple[str, bytes]]:
    """Yield header line and b"", then FRAME line and picture of each whole frame."""
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
    """Write a clip of a moving test picture, each frame different."""
    path.write_bytes(picture_of(size, rate, frames, format, *more))
    return path


@functools.lru_cache(maxsize=4)
def picture_of(size: str, rate: str, frames: int, format: str, *more: object) -> bytes:
    return ffmpeg("-f", "lavfi", "-i", f"testsrc2=size={size}:rate={rate}", "-frames:v", frames, "-pix_fmt", format,
                  *more, "-strict", "-1", "-f", "yuv4mpegpipe", "-")


def frame_md5(path: pathlib.Path) -> list[str]:
    """FFmpeg's checksums of a file's frames."""
    lines = ffmpeg("-i", path, "-f", "framemd5", "-").decode().splitlines()
    return [line.split(",")[-1].strip() for line in lines if not line.startswith("#")]


class Compiler:
    """Compiles a C program of the tests against the installed libraries, as a user does."""

    def __init__(self, folder: pathlib.Path) -> None:
        self.folder = folder

    def __call__(self, name: str, *libraries: str, words: Sequence[str] = ()) -> pathlib.Path:
        program = self.folder / name
        if not program.exists():
            flags = os.environ.get("DDX_CFLAGS", "").split()
            subprocess.run(["gcc", "-std=gnu11", "-Wall", "-Wextra", "-Werror", *flags, *words, f"-I{ROOT}/include",
                            pathlib.Path(__file__).with_name(f"{name}.c"), "-o", program, f"-L{library_folder()}",
                            *(f"-l{library}" for library in libraries), "-lddx"], check=True)
        return program
