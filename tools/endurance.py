#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""make test-long T=endurance: does anything grow over 10,000 toggles and an hour of video? See docs/services.md.

endurance.py [-toggles N] [-minutes N] [-guest-toggles N] [-guest-minutes N]: toggles the image's services on this
machine's own kernel (half an hour instead of a day), each round in a new machine, plays an hour of video there, and
does less of both in an emulated machine, for leaks in its kernel. Finished rounds are in
output/endurance/endurance.jsonl: a stopped run continues there, a run with another image starts over.
"""
import contextlib
import functools
import json
import pathlib
import shlex
import time
from collections.abc import Iterable
from typing import Any

import build
from parts.common import OUTPUT, PATIENCE, Failed, command_line, finish, say, scratch, wait_until
from parts.guest import machine, qemu, session, testdisk
from parts.guest.native_disk import NativeDisk
from parts.guest.native_machine import NativeMachine
from parts.guest.qemu import Guest
from parts.guest.robot import Robot
from parts.image import native
from parts.media import clip, counters
from parts.testing.campaign import Campaign

WORK = OUTPUT / "endurance"
ROUND = 2500    # toggles in one machine
LOOKS = 20      # in a run; growth is the difference between the last and the first quarter of them
GLANCES = 5     # at each look; the least counts, since a short-lived process is not growth
WARM_UP = 100   # toggles before the first look, at most as many as follow
SETTLED = 60    # s of video before the first look: then logs and caches have their full size
DISK = 24 << 30  # bytes; an hour's recording fits
SMALL_DISK = 1 << 10  # MiB, natively; full after five minutes, then the oldest recordings are deleted
SEND, SAVE, V4L = "ddxvideosend", "ddxvideosave", "ddxvideoV4L"
PASSING_ON = (SEND, SAVE, "ddxdecode", "ddxlog")  # toggled services that count frames out
# The toggled services: one in the guest, several at once natively, which share the toggles.
IN_GUEST = (SEND,)
AT_ONCE = (SEND, SAVE, V4L, "ddxdecode", "ddxlog")
SETTINGS = {"ddxvideoload.conf": "loop=\n", f"{SEND}.conf": "interface=lo\n", "ddxdecode.conf": "interface=lo\n"}
# Processes that keep running while others are toggled.
STAYING = ("init", "runsvdir", "runsv", "svlogd", "ddxstore", "ddxvideoload", "ddxhealth")
RECORDING = (*STAYING, SAVE, SEND)
# The kernel's tables and the logs in memory may grow by this much; a leak at each toggle or frame exceeds it.
MEMORY_LIMIT = 1024   # KiB of the whole machine
PROGRAM_LIMIT = 256   # KiB of all processes of one name
FILES_LIMIT = 64      # KiB in /run and /tmp
# Descriptors and processes come and go with requests to the store and the memory of frames.
NUMBER_LIMIT = {"descriptors": 8, "processes": 2}
# Counts the descriptors in the output of `ls -l`, and the items of which a process has the memory of two epochs, until
# a reader has read the former one to its end. The slots of one epoch count as one descriptor, since the logger keeps
# more of them for good after a busy moment. Another descriptor of a slot counts.
COUNT_FILES = ('/^\\/proc/ { process = $1 } / -> / { count++ } '
               '(at = index($0, "/memfd:")) && split(substr($0, at), word, " ") > 4 && word[4] == "frame" { '
               'item = process word[1]; slot = item " " word[2] " " word[5]; slots[slot]; '
               'two += item in epoch && epoch[item] != word[2]; epoch[item] = word[2] } '
               'END { for (slot in slots) count--; for (item in epoch) count++; print count, two + 0 }')
Look = dict[str, int]


def files(robot: Robot) -> tuple[int, int]:
    """Descriptors of all processes, and items of which a process has two epochs."""
    text = robot.sh(f"ls -l /proc/[0-9]*/fd 2> /dev/null | awk {shlex.quote(COUNT_FILES)}")
    count, two = map(int, text.split())
    return count, two


def look(robot: Robot, programs: tuple[str, ...]) -> Look:
    """Memory and files in KiB, descriptors and processes, after caches were dropped."""
    if isinstance(robot, Guest):
        robot.sh("sync; echo 3 > /proc/sys/vm/drop_caches")
    several = [(files(robot)[0], int(robot.sh("set -- /proc/[0-9]*; echo $#"))) for _ in range(GLANCES)]
    found = {"descriptors": min(one for one, _ in several), "processes": min(one for _, one in several),
             "files": int(robot.sh("echo $(($(du -skx /run /tmp | awk '{ n += $1 } END { print n }') - "
                                   "$(du -skx /run/log | cut -f 1)))"))}
    if isinstance(robot, Guest):  # natively that is the host's
        found["available"] = int(robot.sh("awk '/^MemAvailable/ { print $2 }' /proc/meminfo"))
    # The sum for each process name. When a process exits meanwhile, cat continues, while awk would stop.
    text = robot.sh("cat /proc/[0-9]*/status 2> /dev/null | awk '/^Name/ { name = $2 } /^RssAnon/ { sum[name] += $2 } "
                    "END { for (name in sum) print name, sum[name] }'")
    memory = dict(line.split() for line in text.splitlines())
    return {**found, **{name: int(memory[name]) for name in programs}}


def settled(robot: Robot, names: tuple[str, ...]) -> None:
    """Wait until the services just switched on run with all their resources, and all toggles are finished."""
    for name in names:
        robot.wait_until(f"ddxctl status {name} | grep -q state=running")
    # Each toggle copies the settings, under a `timeout` process that exits a second or two later.
    robot.wait_until("! pgrep -f settings-cop[y]")
    for name in names:
        if name in PASSING_ON:
            passes_on(robot, name)
    wait_until(lambda: not requests_are_logged(robot), "ddxlog holds what has no writer", 1)
    wait_until(lambda: files(robot)[1] == 0, "a program keeps the memory of a former epoch", 1)


def requests_are_logged(robot: Robot) -> bool:
    """Whether the logger still reads request items without a writer; it leaves them after five seconds."""
    return any(item["name"].endswith(".request") and not item["writer_pid"] and item["readers"] > 1
               for item in json.loads(robot.sh("ddxctl list --json"))["items"])


def passes_on(robot: Robot, name: str) -> None:
    """Wait until the program has passed on another frame, for which it needs all its memory and files."""
    begin = passed_on(robot, name)
    wait_until(lambda: passed_on(robot, name) > begin, f"{name} passes no frame on", 1)


def passed_on(robot: Robot, name: str) -> int:
    """Number of frames that the program has passed on."""
    return sum(one.out for one in counters.of(name, robot.sh("ddxctl stats --json")))


def switch(robot: Robot, names: tuple[str, ...], times: int) -> None:
    """Switch each service off and on `times` times, as a technician does, all services at once."""
    # A console takes one line.
    robot.sh(f"toggle() {{ left={times}; while [ $left -gt 0 ]; do ddxctl disable $1 && ddxctl enable $1 || return 1; "
             f"left=$((left - 1)); done > /dev/null; }}; all= failed=; "
             f"for name in {' '.join(names)}; do toggle $name & all=\"$all $!\"; done; "
             'for one in $all; do wait $one || failed=yes; done; [ -z "$failed" ]',
             PATIENCE + 20 * times * len(names))


def toggles(robot: Robot, names: tuple[str, ...], count: int, times: int = LOOKS) -> list[Look]:
    """Toggle; a look before the toggles and `times` looks between them."""
    step = max(1, count // times // len(names) // 2)  # of each name, off and on
    switch(robot, names, max(1, min(WARM_UP, count) // len(names) // 2))
    settled(robot, names)
    looks = [look(robot, STAYING)]
    done = 0
    while done < count:
        switch(robot, names, step)
        settled(robot, names)
        looks.append(look(robot, STAYING))
        done += 2 * step * len(names)
        say(f"endurance: {done} toggles")
    restarts = robot.sh("cd /run/service; grep -v '^0$' */restarts || true")
    if restarts:
        raise Failed(f"services that were only switched count as died: {restarts}")
    return looks


def video(robot: Robot, programs: tuple[str, ...], minutes: int) -> list[Look]:
    time.sleep(SETTLED)
    looks = [look(robot, programs)]
    for minute in range(minutes):
        time.sleep(60)
        looks.append(look(robot, programs))
        say(f"endurance: {minute + 1} minutes")
    return looks


def growth(looks: list[Look]) -> list[str]:
    """The figures that have grown from the first to the last quarter of the looks; in favour of less growth, since a
    short-lived process is not growth."""
    some = max(1, len(looks) // 4)
    found = []
    for name in looks[0]:
        begin, end = [one[name] for one in looks[:some]], [one[name] for one in looks[-some:]]
        if name == "available":
            more = min(begin) - max(end)
            limit = MEMORY_LIMIT
        else:
            more = min(end) - max(begin)
            limit = {**NUMBER_LIMIT, "files": FILES_LIMIT}.get(name, PROGRAM_LIMIT)
        if more > limit:
            found.append(f"{name}: {more} {'less' if name == 'available' else 'more'}, from {begin} to {end}")
    return found


def in_guest(image: pathlib.Path, accel: str, kind: str, amount: int) -> list[Look]:
    """Toggles, or minutes of video, in an emulated machine."""
    WORK.mkdir(parents=True, exist_ok=True)
    disk = testdisk.make(WORK / "test.img", clip.write(WORK / "clip.y4m", 10), SETTINGS)
    with Guest(image, accel, machine.machines(machine.DEV)[0], test_disk=disk, size=DISK, more_memory=64,
               provision=f"service={SEND} on\nservice={V4L} off\n") as guest:
        guest.shell()
        session.wait_for_recording(guest)
        if kind == "toggles":
            guest.sh(f"ddxctl disable {SAVE}")  # its files would fill the disk
            return toggles(guest, IN_GUEST, amount)
        return video(guest, RECORDING, amount)


def natively(root: pathlib.Path, kind: str, amount: int, times: int = LOOKS) -> list[Look]:
    """Toggles, with `times` looks, or minutes of video, on this machine's own kernel."""
    with scratch() as keep:
        for name in ("test", "rec"):
            (keep / name).mkdir()
        testdisk.fill(keep / "test", clip.write(keep / "clip.y4m", 1),
                      {**SETTINGS, f"{SAVE}.conf": "segment=16\nfull=recycle\n"})
        disk: contextlib.AbstractContextManager[object] = contextlib.nullcontext()
        if kind == "video":
            disk = NativeDisk(SMALL_DISK, keep / "rec")
        with disk, NativeMachine(root, keep) as robot:
            for name in AT_ONCE:
                robot.sh(f"ddxctl enable {name}")
            if kind == "toggles":
                return toggles(robot, AT_ONCE, amount, times)
            settled(robot, AT_ONCE)
            return video(robot, (*STAYING, *PASSING_ON), amount)


def campaign(made_of: Iterable[pathlib.Path]) -> Campaign:
    return Campaign(WORK / "endurance.jsonl", made_of)


def one_round(image: pathlib.Path, accel: str, kind: str, amount: int) -> dict[str, Any]:
    begin = time.monotonic()
    looks = (natively(image.parent / "root", kind.split()[1], amount) if kind.startswith("native")
             else in_guest(image, accel, kind, amount))
    return {"kind": kind, "seconds": round(time.monotonic() - begin), "growth": growth(looks), "looks": looks}


def main() -> int:
    arguments = command_line(__doc__, toggles=10000, minutes=60, guest_toggles=400, guest_minutes=10)
    rounds = range(0, arguments.toggles, ROUND)
    wanted = [("native toggles", min(ROUND, arguments.toggles - begin)) for begin in rounds]
    wanted += [(kind, n) for kind, n in (("native video", arguments.minutes), ("toggles", arguments.guest_toggles),
                                         ("video", arguments.guest_minutes)) if n]
    image = build.dev([native.build()])
    accel = qemu.acceleration(image)
    steps = campaign([image])
    done = [steps.once(f"{number}: {amount} {kind}", functools.partial(one_round, image, accel, kind, amount))
            for number, (kind, amount) in enumerate(wanted)]
    grown = [f"{one['kind']}: {text}" for one in done for text in one["growth"]]
    for text in grown:
        say(f"endurance: {text}")
    say(f"endurance: {len(done)} rounds, {'something grows' if grown else 'nothing grows'}")
    return 1 if grown else 0


if __name__ == "__main__":
    finish("endurance", main)
