# SPDX-License-Identifier: GPL-2.0-or-later
"""A clip through a guest, for `make run` and boot tests: follow it, stop the recorder, extract and compare the
recording."""
import dataclasses
import json
import pathlib
import time
from collections.abc import Callable

from parts.common import PATIENCE, Failed
from parts.guest.qemu import Guest
from parts.guest.robot import Robot
from parts.media import counters
from parts.media.counters import Counters, adds_up, agree
from parts.media.recording import Comparison, FileSystem, compare

LOAD, SAVE = "ddxvideoload", "ddxvideosave"
Show = Callable[[float, dict[str, Counters]], None]


@dataclasses.dataclass
class Result:
    load: Counters
    save: Counters
    outside: Comparison
    disagreements: list[str]
    before: int = 0  # frames in the store before the recorder started

    @property
    def lost_store(self) -> int:
        """Frames of the clip that the store lost."""
        return self.outside.clip + self.before - self.load.out + self.save.lost.get("store", 0)

    @property
    def lost_record(self) -> int:
        """Frames that the recorder received and did not write."""
        return self.outside.clip - self.outside.recorded - self.lost_store

    @property
    def good(self) -> bool:
        """Whether all frames are recorded, without those that the camera's driver lost."""
        way = self.outside.clip - self.load.lost.get("driver", 0)
        return not self.disagreements and not self.outside.missing and self.outside.recorded == way


def follow(guest: Guest, seconds: float, show: Show | None = None) -> dict[str, Counters]:
    """The present counters of all instances, which are also passed to `show`."""
    _, text = guest.shell().run("ddxctl stats --json")
    seen = {now.instance: now for line in text.splitlines() if (now := counters.parse(line))}
    if show and seen:
        show(seconds, seen)
    return seen


def ended(program: str) -> str:
    """A shell condition: the program's plain instance is complete or stopped. It starts no program, to leave the CPU to
    the guest."""
    folder = f"/run/service/{program}"
    return (f"{{ read -r word < {folder}/supervise/stat; }} 2> /dev/null && [ \"$word\" = down ] && "
            f"{{ [ -e {folder}/complete ] || [ -e {folder}/down ]; }}")


def wait_for_recording(guest: Guest) -> None:
    """Wait until the recorder has recorded a frame."""
    guest.wait_until(f"ddxctl stats --json | grep -q '{SAVE}.*\"out\":[1-9]'")


def wait_for_clip(guest: Guest, frames: int, show: Show | None = None, rate: float = 25.0) -> None:
    """Wait for the end of the clip; `show` gets the counters once a second."""
    begin = time.monotonic()
    limit = PATIENCE + 3 * frames / rate
    try:
        if not show:
            guest.wait_until(ended(LOAD), limit)
        while show:
            second = time.monotonic()
            follow(guest, second - begin, show)
            if guest.shell().run(ended(LOAD))[0] == 0:
                break
            if second - begin > limit:
                raise Failed(f"not within {limit:.0f} s")
            time.sleep(max(0.0, 1.0 - (time.monotonic() - second)))
    except Failed as error:
        raise Failed(f"the clip is not through: {error}; counters: {follow(guest, 0) or 'none'}") from None


def end_counters(guest: Robot, program: str) -> Counters:
    """The program's last counters in its log, which svlogd writes a moment later."""
    deadline = time.monotonic() + PATIENCE
    while True:
        result = counters.last(guest.sh(f"cat /run/log/{program}/current"))
        if result.instance or time.monotonic() > deadline:
            return result
        time.sleep(0.2)


def histogram(guest: Guest, instance: str) -> list[int]:
    """Frames by latency, from the program's statistics in the store; see report.bucket_us() for each entry."""
    return list(json.loads(guest.sh(f"ddxctl show {instance}.stats --json"))["value"]["latency"])


def stop_recorder(guest: Guest) -> None:
    """Stop the recorder and sync the disk; then the recordings' partition can be read from outside."""
    guest.sh("/etc/init.d/S*ddxvideosave stop")
    guest.sh("mount -o remount,ro /rec && sync")


def judge(clip: pathlib.Path, recording: pathlib.Path, load: Counters, save: Counters) -> Result:
    """Compare the frames in the two files, and with the programs' counters."""
    result = Result(load, save, compare(clip, recording), [])
    outside = result.outside
    for what, ours, theirs in [
            ("frames in the clip", outside.clip, load.frames_in),
            ("frames in the recording", outside.recorded, save.out),
            ("published and received", load.out, save.frames_in),
            ("lost", outside.clip - outside.recorded, load.lost_total + save.lost_total)]:
        agree(result.disagreements, what, ours, theirs)
    adds_up(result.disagreements, load, save)
    if outside.exact and len(outside.missing) != outside.clip - outside.recorded:
        result.disagreements.append(f"{len(outside.missing)} frames of the clip are missing, but the recording has "
                                    f"{outside.recorded} of {outside.clip}")
    if outside.foreign:
        result.disagreements.append(f"recorded frames that are not the clip's: {outside.foreign[:10]}")
    if outside.unordered:
        result.disagreements.append(f"{outside.unordered} frames without a rising time stamp")
    return result


def collect(guest: Guest, clip: pathlib.Path, into: pathlib.Path) -> Result:
    """After stop_recorder(): extract the only recording and compare it with the clip."""
    partition = FileSystem(guest.snapshot())
    for where in partition.lost():
        print(where)
    partition.take_only("video", into)
    return judge(clip, into, end_counters(guest, LOAD), end_counters(guest, SAVE))
