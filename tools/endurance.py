#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""make endurance: does anything grow over 10,000 toggles and an hour of video? See docs/services.md.

endurance.py [-toggles N] [-minutes N]: in rounds, each in a machine that has just started; what is done already is in
output/endurance.json, and a run that was broken off goes on behind it. Removing the file begins anew.
"""
import argparse
import json
import pathlib
import sys
import time

import build
import clip
import machine
import native
import qemu
import session
import testdisk
from common import OUTPUT, PATIENCE, Failed, say
from counters import Counters
from qemu import Guest

RESULT = OUTPUT / "endurance.json"
ROUND = 1000    # toggles in one machine
STEP = 50       # toggles between two looks
WARM_UP = 100   # toggles, or
SETTLED = 60    # seconds of video, before the first look: logs and caches are as large as they get
DISK = 24 << 30  # bytes; an hour's recording fits
SEND = "ddxvideosend"
PROGRAMS = ("store", "ddxvideoload", "ddxvideosave", "ddxvideosend", "ddxhealth", "runsvdir")
# A machine keeps some: the kernel's own tables, the logs in memory. What leaks at each toggle or frame shows as more.
MEMORY_LIMIT = 1024  # KiB between first and last look
Look = dict[str, int]


def look(guest: Guest) -> Look:
    """Memory in KiB, descriptors and processes, after what can be given back has been."""
    guest.sh("sync; echo 3 > /proc/sys/vm/drop_caches")
    found = {"available": int(guest.sh("awk '/^MemAvailable/ { print $2 }' /proc/meminfo")),
             "descriptors": int(guest.sh("ls -d /proc/[0-9]*/fd/* 2> /dev/null | wc -l")),
             "processes": int(guest.sh("ls -d /proc/[0-9]* | wc -l"))}
    for name in PROGRAMS:
        status = guest.sh(f"cat /proc/$(pidof -s {name} || echo self)/status")
        found[name] = int(next(line.split()[1] for line in status.splitlines() if line.startswith("RssAnon")))
    return found


def settled(guest: Guest) -> None:
    """The sender, which was switched on just now, has all that it needs: it sends."""
    begin = session.follow(guest, 0).get(SEND, Counters()).out
    end = time.monotonic() + PATIENCE
    while session.follow(guest, 0).get(SEND, Counters()).out <= begin:
        if time.monotonic() > end:
            raise Failed(f"{SEND} does not send")
        time.sleep(1)


def toggles(guest: Guest, count: int) -> list[Look]:
    """The sender off and on again, as a technician does it."""
    looks = []
    for begin in range(0, WARM_UP + count, STEP):
        if begin >= WARM_UP:
            settled(guest)
            looks.append(look(guest))
        guest.sh(f"i=0; while [ $i -lt {STEP // 2} ]; do ddxctl disable ddxvideosend && ddxctl enable ddxvideosend || "
                 "break; i=$((i + 1)); done; " f"[ $i -eq {STEP // 2} ]", 60 + 20 * STEP)
        say(f"endurance: {begin + STEP} toggles")
    settled(guest)
    return [*looks, look(guest)]


def video(guest: Guest, minutes: int) -> list[Look]:
    time.sleep(SETTLED)
    looks = [look(guest)]
    for minute in range(minutes):
        time.sleep(60)
        looks.append(look(guest))
        say(f"endurance: {minute + 1} minutes")
    return looks


def growth(looks: list[Look]) -> list[str]:
    """What is more at the end than at the beginning."""
    first, last = looks[0], looks[-1]
    found = [f"{name}: from {first[name]} to {last[name]}" for name in ("descriptors", "processes")
             if last[name] > first[name]]
    found += [f"{name}: {last[name] - first[name]} KiB more" for name in PROGRAMS
              if last[name] - first[name] > MEMORY_LIMIT // 4]
    if first["available"] - last["available"] > MEMORY_LIMIT:
        found.append(f"{first['available'] - last['available']} KiB less memory available")
    return found


def one_round(image: pathlib.Path, accel: str, kind: str, amount: int) -> list[Look]:
    work = OUTPUT / "endurance"
    work.mkdir(parents=True, exist_ok=True)
    disk = testdisk.make(work / "test.img", clip.write(work / "clip.y4m", 10), {"ddxvideoload.conf": "loop=\n"})
    with Guest(image, accel, machine.machines(machine.DEV)[0], test_disk=disk, size=DISK, more_memory=64,
               provision="service=ddxvideosend on\nservice=ddxvideoV4L off\n") as guest:
        guest.shell()
        session.wait_for_recording(guest)
        if kind == "toggles":
            guest.sh("ddxctl disable ddxvideosave")  # its files would fill the disk meanwhile
            return toggles(guest, amount)
        return video(guest, amount)


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("-toggles", type=int, default=10000)
    parser.add_argument("-minutes", type=int, default=60)
    arguments = parser.parse_args()
    done: list[dict[str, object]] = json.loads(RESULT.read_text()) if RESULT.exists() else []
    wanted = [("toggles", min(ROUND, arguments.toggles - begin)) for begin in range(0, arguments.toggles, ROUND)]
    wanted += [("video", arguments.minutes)] if arguments.minutes else []
    try:
        image = build.dev([native.build()])
        accel = qemu.acceleration(image)
        for kind, amount in wanted[len(done):]:
            looks = one_round(image, accel, kind, amount)
            done.append({"kind": kind, "amount": amount, "growth": growth(looks), "looks": looks})
            RESULT.write_text(json.dumps(done, indent=1))
    except Failed as error:
        say(f"endurance: {error}")
        return 1
    grown = [f"{one['kind']}: {text}" for one in done for text in one["growth"]]  # type: ignore[attr-defined]
    for text in grown:
        say(f"endurance: {text}")
    say(f"endurance: {len(done)} rounds, {'something grows' if grown else 'nothing grows'}")
    return 1 if grown else 0


if __name__ == "__main__":
    sys.exit(main())
