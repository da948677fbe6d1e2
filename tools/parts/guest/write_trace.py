# SPDX-License-Identifier: GPL-2.0-or-later
"""The time that a guest's recorder waits in its writes, measured by the guest's kernel (ftrace)."""
import re

from parts.guest.qemu import Guest

FOLDER = "/sys/kernel/tracing"
LEAST = {"write": 65536, "pwrite64": 0}  # bytes; many programs call write(), only the naive one with so much
LINE = re.compile(r"^-(\d+)\s+\[\d+\]\s+\S+\s+(\d+\.\d+): sys_(\w+)(\(.*|.*)$")
BUFFER = re.compile(r"buf: ([0-9a-f]+)")


def start(guest: Guest, call: str) -> None:
    """`call`: write or pwrite64."""
    events = f"{FOLDER}/events/syscalls"
    guest.sh(f"mountpoint -q {FOLDER} || mount -t tracefs none {FOLDER}; echo 8192 > {FOLDER}/buffer_size_kb; "
             f"echo 'count > {LEAST[call]}' > {events}/sys_enter_{call}/filter; "
             f"echo 'ret > {LEAST[call]}' > {events}/sys_exit_{call}/filter; "
             f"echo 1 > {events}/sys_enter_{call}/enable; echo 1 > {events}/sys_exit_{call}/enable")


def longest(guest: Guest) -> tuple[float, int]:
    """ms of the longest write of pictures, and the number of such writes."""
    begun: dict[int, float] = {}
    took: dict[int, list[float]] = {}
    places: dict[int, set[str]] = {}
    guest.sh(f"echo 0 > {FOLDER}/tracing_on")
    for line in guest.sh(f"sed -n 's/^.*-\\([0-9]* .*sys_\\)/-\\1/p' {FOLDER}/trace").splitlines():
        if not (match := LINE.match(line)):
            continue
        thread, time = int(match[1]), float(match[2])
        if buffer := BUFFER.search(match[4]):
            begun[thread] = time
            places.setdefault(thread, set()).add(buffer[1])
        elif thread in begun:
            took.setdefault(thread, []).append(time - begun.pop(thread))
    if not took:
        return 0.0, 0
    # Threads that prepare files and write the index use the same buffer each time; pictures are in different ones.
    chosen = max(took, key=lambda thread: len(places[thread]))
    return round(1000 * max(took[chosen]), 1), len(took[chosen])
