# SPDX-License-Identifier: GPL-2.0-or-later
"""A looped clip that a guest records on a slow disk, and the fate of its frames."""
import dataclasses
import pathlib

from parts.common import Failed
from parts.guest import guest_program, machine, session, testdisk, write_trace
from parts.guest.native_disk import NativeDisk
from parts.guest.qemu import Guest
from parts.guest.robot import Robot
from parts.guest.session import LOAD, SAVE
from parts.guest.slow_disk import SlowDisk, Speed
from parts.image import native
from parts.media import record_check
from parts.media.clip import RATE
from parts.media.counters import Counters
from parts.media.record_check import Found

CLIP_SECONDS = 20
FRAMES = CLIP_SECONDS * RATE
PROGRAMS = ("naive", "neighbour")
READERS = ("naive", "marks")  # programs with libddx
HERTZ = 20.0  # of the neighbour's fsync
# In the provisioning file: no service starts before the disk is mounted
QUIET = f"service={SAVE} off\nservice={LOAD} off\n"
READY = 2  # files that the recorder prepares before it needs them
NAIVE_FILE = "naive"


@dataclasses.dataclass
class Result:
    found: Found
    load: Counters
    save: Counters
    stall_ms: float | None  # longest write of pictures; measured in an emulated machine only
    neighbour: int   # number of fsyncs of the neighbour


def program(name: str, folder: pathlib.Path, board: str = machine.DEV) -> pathlib.Path:
    return guest_program.build(name, folder, board, native.static_library() if name in READERS else [])


def programs(folder: pathlib.Path) -> dict[str, pathlib.Path]:
    return {name: program(name, folder) for name in PROGRAMS}


def content(work: pathlib.Path, settings: str = "") -> testdisk.Files:
    """Files for the test disk beside the clip: the two programs and the recorder's settings."""
    return {**programs(work), f"{LOAD}.conf": "loop=\n", f"{SAVE}.conf": settings}


def test_disk(work: pathlib.Path, clip: pathlib.Path, settings: str = "") -> pathlib.Path:
    return testdisk.make(work / "disk-session.img", clip, content(work, settings))


def prepare(guest: Guest, disk: SlowDisk) -> None:
    guest.shell()
    disk.mount(guest)
    take_programs(guest)


def take_programs(guest: Robot) -> None:
    guest.sh(f"for name in {' '.join(PROGRAMS)}; do cp /test/$name /tmp; chmod 755 /tmp/$name; done")


def start_program(guest: Robot, name: str, arguments: str) -> None:
    guest.sh(f"cd /; nohup /tmp/{name} {arguments} > /tmp/{name}.said 2>&1 & echo $! > /tmp/{name}.pid")


def end_program(guest: Robot, name: str) -> list[int]:
    """Stop a program; the numbers that it prints at its end."""
    pid = guest.sh(f"read -r pid < /tmp/{name}.pid && kill $pid && echo $pid")
    guest.wait_until(f"! [ -d /proc/{pid} ]")
    said = guest.sh(f"cat /tmp/{name}.said")
    return [int(word) for word in said.split()]


def prepared(guest: Robot) -> None:
    """Wait until the recorder has prepared files, as on a machine that has run for some time."""
    ready = "for file in /rec/pool/*.index; do tail -c +9 $file | head -c 1; done | tr '\\001' R | grep -o R | wc -l"
    guest.sh(f"(for i in $(seq 400); do [ $({ready}) -lt {READY} ] || exit 0; sleep 0.5; done 2> /dev/null; "
             f"cat /run/log/{SAVE}/current; ls -la /rec/pool; exit 1)", 300)


def begin(guest: Guest, disk: SlowDisk, speed: Speed | None, naive: bool = False, cold: bool = False,
          hertz: float = HERTZ) -> None:
    """Record: the clip begins when the recorder runs. `cold`: before the recorder has prepared files."""
    if naive:
        start_program(guest, "naive", f"video /rec/{NAIVE_FILE}")
    else:
        begin_recorder(guest, cold)
    write_trace.start(guest, "write" if naive else "pwrite64")
    if speed:
        disk.limit(guest, speed)
    begin_clip(guest, hertz)


def begin_recorder(guest: Robot, cold: bool = False) -> None:
    guest.sh(f"ddxctl enable {SAVE}")
    if not cold:
        prepared(guest)


def begin_clip(guest: Robot, hertz: float = HERTZ) -> None:
    start_program(guest, "neighbour", f"/rec/neighbour {hertz}")
    guest.sh(f"ddxctl enable {LOAD}")


def end(guest: Robot, disk: SlowDisk | NativeDisk, naive: bool = False, frames: int = FRAMES) -> Result:
    """Stop the source first, so that all published frames arrive, then the other programs, and check the disk. The clip
    has `frames` frames."""
    guest.sh(f"/etc/init.d/S*{LOAD} stop")
    load = session.end_counters(guest, LOAD)
    save, counts = Counters(), []
    if naive:
        counts = end_program(guest, "naive")
    else:
        guest.sh(f"/etc/init.d/S*{SAVE} stop")
        save = session.end_counters(guest, SAVE)
    neighbour, = end_program(guest, "neighbour")
    stall = write_trace.longest(guest)[0] if isinstance(guest, Guest) else None
    guest.sh("sync; umount /rec")
    if naive and len(counts) != 2:
        raise Failed("the naive writer has failed")
    found = (record_check.naive(disk.image, NAIVE_FILE, load, counts[0], counts[1], frames) if naive
             else record_check.recorder(disk.image, load, save, frames))
    return Result(found, load, save, stall, neighbour)
