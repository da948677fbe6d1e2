# SPDX-License-Identifier: GPL-2.0-or-later
"""A clip through the guest: follow it, stop the recorder, take the recording out and compare, as `make run` and the
boot tests do."""
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
    before: int = 0  # frames that were in the store before the recorder was there

    @property
    def lost_store(self) -> int:
        """Frames of the clip that did not get through the store."""
        return self.outside.clip + self.before - self.load.out + self.save.lost.get("store", 0)

    @property
    def lost_record(self) -> int:
        """Frames that the recorder got and that are not in its file."""
        return self.outside.clip - self.outside.recorded - self.lost_store

    @property
    def good(self) -> bool:
        """What the camera's driver lost has never been on the way."""
        way = self.outside.clip - self.load.lost.get("driver", 0)
        return not self.disagreements and not self.outside.missing and self.outside.recorded == way


def follow(guest: Guest, seconds: float, show: Show | None = None) -> dict[str, Counters]:
    """The counters of all instances as they are now; `show` gets them, too."""
    _, text = guest.shell().run("ddxctl stats --json")
    seen = {now.instance: now for line in text.splitlines() if (now := counters.parse(line))}
    if show and seen:
        show(seconds, seen)
    return seen


def ended(program: str) -> str:
    """The condition in the guest that its plain instance is complete, or was stopped. The shell finds out by itself: a
    program each time would take from the very machine that is watched."""
    folder = f"/run/service/{program}"
    return (f"{{ read -r word < {folder}/supervise/stat; }} 2> /dev/null && [ \"$word\" = down ] && "
            f"{{ [ -e {folder}/complete ] || [ -e {folder}/down ]; }}")


def wait_for_recording(guest: Guest) -> None:
    """Until the recorder has recorded something."""
    guest.wait_until(f"ddxctl stats --json | grep -q '{SAVE}.*\"out\":[1-9]'")


def wait_for_clip(guest: Guest, frames: int, show: Show | None = None, rate: float = 25.0) -> None:
    """Until the whole clip went through; `show` gets the counters once a second."""
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
    """What the program said last; its log is written by svlogd, a moment later."""
    deadline = time.monotonic() + PATIENCE
    while True:
        result = counters.last(guest.sh(f"cat /run/log/{program}/current"))
        if result.instance or time.monotonic() > deadline:
            return result
        time.sleep(0.2)


def histogram(guest: Guest, instance: str) -> list[int]:
    """Frames by latency, from the program's book in the store; report.bucket_us() tells what each entry means."""
    return list(json.loads(guest.sh(f"ddxctl show {instance}.stats --json"))["value"]["latency"])


def stop_recorder(guest: Guest) -> None:
    """A clean stop, and everything on the disk; the recording partition may be read from outside afterwards."""
    guest.sh("/etc/init.d/S*ddxvideosave stop")
    guest.sh("mount -o remount,ro /rec && sync")


def judge(clip: pathlib.Path, recording: pathlib.Path, load: Counters, save: Counters) -> Result:
    """Frames are counted from the two files; the programs' counters have to say the same."""
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
    """After stop_recorder(): the only recording, compared with the clip."""
    partition = FileSystem(guest.snapshot())
    for where in partition.lost():
        print(where)
    partition.take_only("video", into)
    return judge(clip, into, end_counters(guest, LOAD), end_counters(guest, SAVE))
