#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""make test-long T=killed: does a machine record again without help, each time its plug was pulled?

killed.py [-times N] [-seed N]: QEMU is killed (SIGKILL) while the guest records, boots or checks its file systems, and
started again on the same disk. BOARD= chooses the image, FIRMWARE= its firmware. A stopped run continues after the last
kill in output/killed/killed.jsonl; a run with another image, machine or seed starts over, on a new disk.
"""
import dataclasses
import hashlib
import os
import pathlib
import random
import time
from collections.abc import Callable

import build
from parts import processes
from parts.common import OUTPUT, PATIENCE, Failed, command_line, finish, say
from parts.guest import machine, qemu, session, testdisk
from parts.guest.machine import Machine
from parts.guest.qemu import Guest
from parts.guest.session import SAVE
from parts.media import clip as default_clip, y4m
from parts.media.recording import FileSystem
from parts.testing.campaign import Campaign

WORK = OUTPUT / "killed"
CHECK = b"Starting storage"  # overlay/etc/init.d/S15storage
SETTINGS = {"ddxvideoload.conf": "loop=\n", f"{SAVE}.conf": "segment=8\n"}
RECORDS = PATIENCE           # s after power on
KINDS = ("recording", "boot", "check")
SIZE = 8 << 30               # of the disk, with room for a run's recordings


@dataclasses.dataclass
class Kill:
    """A kill, and what the machine did afterwards."""
    kind: str
    after: float            # s since power on, since the check began, or of recording
    again: float = -1.0     # s from power on to the first recorded frame
    thorough: bool = False  # the disk's quick check was not enough
    files: int = 0          # of recordings at that time


def plan(times: int, seed: int) -> list[Kill]:
    """Half of the kills hit a recording machine; the boots that these need also check the kills before them."""
    chance = random.Random(seed)
    limits = {"recording": 4.0, "boot": 8.0, "check": 1.0}
    kinds = [KINDS[0] if number % 2 == 0 else KINDS[1 + number // 2 % 2] for number in range(times)]
    return [Kill(kind, round(chance.uniform(0, limits[kind]), 3)) for kind in kinds]


class Plug:
    """A machine that is killed and started again, with the same disk."""

    patience = RECORDS

    def __init__(self, image: pathlib.Path, accel: str, board: Machine, folder: pathlib.Path,
                 clip: pathlib.Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.image, self.accel, self.board, self.folder, self.clip = image, accel, board, folder, clip
        self.test = testdisk.make(folder / "test.img", clip, SETTINGS)

    def boot(self) -> Guest:
        return Guest(self.image, self.accel, self.board, test_disk=self.test, keep=self.folder, size=SIZE)

    def pull(self, kill: Kill, guest: Guest) -> None:
        """Kill a guest that has just been started, or that records."""
        if kill.kind == "check":
            guest.wait_for_log(CHECK, RECORDS)
        time.sleep(kill.after)
        processes.kill(guest.process)

    def judge(self, guest: Guest, kills: list[Kill]) -> None:
        """After these kills the machine must boot and record without help."""
        while True:
            seen = session.follow(guest, 0) if guest.shell(timeout=RECORDS) else {}
            if SAVE in seen and seen[SAVE].out:
                break
            if time.monotonic() - guest.begin > self.patience:
                raise Failed(f"does not record again after {kills}\n{guest.sh('ddxctl health || true')}\n"
                             + guest.sh("cat /run/log/check.* || true"))
            time.sleep(0.2)
        thorough = "UNEXPECTED INCONSISTENCY" in guest.sh("cat /run/log/check.DDXREC")
        for kill in kills:
            kill.again, kill.thorough = round(time.monotonic() - guest.begin, 1), thorough
            kill.files = int(guest.sh("ls /rec/*.y4m | wc -l"))

    def end(self, guest: Guest) -> tuple[int, int]:
        """Stop the machine; return the number of recorded pictures, and of those that do not match the index."""
        session.stop_recorder(guest)
        known = {hashlib.blake2b(frame.data).digest(): number for number, frame in enumerate(y4m.read(self.clip)[1])}
        partition = FileSystem(guest.snapshot())
        count = wrong = 0
        for name, index in partition.indexes().items():
            file = partition.take(name, self.folder / "one.y4m")
            for entry, frame in zip(index.entries, y4m.read(file)[1], strict=True):
                count += 1
                wrong += known.get(hashlib.blake2b(frame.data).digest()) != (entry.sequence - 1) % len(known)
            file.unlink()
        return count, wrong


def run(plug: Plug, kills: list[Kill], done: list[Kill], tell: Callable[[list[Kill]], None]) -> list[Kill]:
    """Run the kills. The next boot that comes up judges them; the result is the kills that are not judged yet."""
    waiting: list[Kill] = []
    for kill in kills[len(done):]:
        with plug.boot() as guest:
            if kill.kind == "recording":
                plug.judge(guest, waiting)
                done.extend(waiting)
                waiting.clear()
                tell(done)
            waiting.append(kill)
            plug.pull(kill, guest)
    return waiting


def campaign(image: pathlib.Path, board: Machine, seed: int) -> Campaign:
    return Campaign(WORK / "killed.jsonl", [image], [WORK / "disk.qcow2"], seed=seed, machine=dataclasses.asdict(board))


def keep(steps: Campaign, done: list[Kill]) -> None:
    for number, one in enumerate(done[len(steps.results):], len(steps.results)):
        steps.add(f"kill {number}", dataclasses.asdict(one))
    say(f"killed: {len(done)} times, recorded again every time")


def main() -> int:
    arguments = command_line(__doc__, times=100, seed=1)
    board = machine.machines(os.environ.get("BOARD") or machine.DEV)[0]
    image, development = build.images(board.board)
    steps = campaign(image, board, arguments.seed)
    done = [Kill(**one) for one in steps.results.values()]
    clip = default_clip.write(WORK / "clip.y4m", 20)
    plug = Plug(image, qemu.acceleration(development), board, WORK, clip)
    last = run(plug, plan(arguments.times, arguments.seed), done, lambda done: keep(steps, done))
    with plug.boot() as guest:
        plug.judge(guest, last)
        done.extend(last)
        keep(steps, done)
        count, wrong = plug.end(guest)
    times = sorted(one.again for one in done)
    say(f"killed: {len(done)} times, recorded again every time, after {times[len(times) // 2]} s (at most "
        f"{times[-1]} s); the quick check was not enough {sum(one.thorough for one in done)} times; "
        f"{count} pictures, {wrong} wrong")
    return 1 if wrong else 0


if __name__ == "__main__":
    finish("killed", main)
