# SPDX-License-Identifier: GPL-2.0-or-later
"""A clip through the guest: follow it, stop the recorder, take the recording out and compare, as `make run` and the
boot tests do."""
import dataclasses
import pathlib
import time
from collections.abc import Callable

import counters
from common import Failed
from counters import Counters
from qemu import Guest
from recording import Comparison, Partition, compare

LOAD, SAVE = "ddxvideoload", "ddxvideosave"
Show = Callable[[float, dict[str, Counters]], None]


@dataclasses.dataclass
class Result:
    load: Counters
    save: Counters
    outside: Comparison
    disagreements: list[str]

    @property
    def lost_store(self) -> int:
        """Frames of the clip that did not get through the store."""
        return self.outside.clip - self.load.out + self.save.lost.get("store", 0)

    @property
    def lost_record(self) -> int:
        """Frames that the recorder got and that are not in its file."""
        return self.outside.clip - self.outside.recorded - self.lost_store

    @property
    def good(self) -> bool:
        return not self.disagreements and not self.outside.missing and self.outside.recorded == self.outside.clip


def state(guest: Guest, program: str) -> str:
    """running, complete, died, stopped ... of the plain instance."""
    _, text = guest.shell().run(f"/etc/init.d/S*{program} status")
    for word in text.split():
        if word.startswith("state="):
            return word.removeprefix("state=")
    raise Failed(f"{program} has no status: {text}")


def wait_for_clip(guest: Guest, frames: int, show: Show | None = None, rate: float = 25.0) -> None:
    """Follow the counters once a second until the whole clip went through."""
    begin = time.monotonic()
    limit = 60 + 3 * frames / rate
    seen: dict[str, Counters] = {}
    while True:
        second = time.monotonic()
        _, text = guest.shell().run("ddxctl stats --json")
        seen |= {now.instance: now for line in text.splitlines() if (now := counters.parse(line))}
        if show and seen:
            show(second - begin, seen)
        if state(guest, LOAD) in ("complete", "stopped"):
            return
        if second - begin > limit:
            raise Failed(f"the clip was not through after {limit:.0f} s; the loader is {state(guest, LOAD)}, counters: "
                         + (text or "none"))
        time.sleep(max(0.0, 1.0 - (time.monotonic() - second)))


def end_counters(guest: Guest, program: str) -> Counters:
    """What the program said last; its log is written by svlogd, a moment later."""
    deadline = time.monotonic() + 5
    while True:
        result = counters.last(guest.sh(f"cat /run/log/{program}/current"))
        if result.instance or time.monotonic() > deadline:
            return result
        time.sleep(0.2)


def stop_recorder(guest: Guest) -> None:
    """A clean stop, and everything on the disk; the recording partition may be read from outside afterwards."""
    guest.sh("/etc/init.d/S*ddxvideosave stop", timeout=20)
    guest.sh("mount -o remount,ro /rec && sync", timeout=60)


def judge(clip: pathlib.Path, recording: pathlib.Path, load: Counters, save: Counters) -> Result:
    """Frames are counted from the two files; the programs' counters have to say the same."""
    result = Result(load, save, compare(clip, recording), [])
    outside = result.outside

    def agree(what: str, ours: int, theirs: int) -> None:
        if ours != theirs:
            result.disagreements.append(f"{what}: counted {ours}, the program says {theirs}")

    agree("frames in the clip", outside.clip, load.frames_in)
    agree("frames in the recording", outside.recorded, save.out)
    agree("published and received", load.out, save.frames_in)
    agree("lost", outside.clip - outside.recorded, load.lost_total + save.lost_total)
    for name, counts in [(LOAD, load), (SAVE, save)]:
        agree(f"{name}: out + lost + waiting", counts.frames_in, counts.out + counts.lost_total + counts.waiting)
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
    partition = Partition(guest.snapshot())
    names = [name for name in partition.names() if name.endswith(".y4m")]
    if len(names) != 1:
        raise Failed(f"one recording was expected, there are {names}")
    return judge(clip, partition.take(names[0], into), end_counters(guest, LOAD), end_counters(guest, SAVE))
