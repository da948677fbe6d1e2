# SPDX-License-Identifier: GPL-2.0-or-later
"""Size, memory and boot time of an image, compared with the budget."""
import dataclasses
import json
import pathlib
import re

from parts.common import TOP, entries, run
from parts.guest.robot import Robot

BUDGET = TOP / "tests/boot/budget.txt"
NEAR = 0.9
MIB, PAGE = 1 << 20, 4096


@dataclasses.dataclass(frozen=True)
class Item:
    name: str
    value: float
    limit: float
    unit: str
    text: str

    @property
    def verdict(self) -> str:
        if self.value > self.limit:
            return "over"
        return "near" if self.value > NEAR * self.limit else "fine"


def limit(words: str, board: str) -> float:
    """The board's limit of `LIMIT[,BOARD=LIMIT]...`."""
    usual, *others = words.split(",")
    return float(dict(one.split("=") for one in others).get(board, usual))


def judge(values: dict[str, float], board: str) -> list[Item]:
    """The budget's lines with a measured value."""
    items = []
    for line in entries(BUDGET):
        name, limits, unit, text = line.split(None, 3)
        if name in values:
            items.append(Item(name, round(values[name], 2), limit(limits, board), unit, text))
    return items


def table(items: list[Item]) -> str:
    return "\n".join(f"{one.name:12} {one.value:8.2f} of {one.limit:4.1f} {one.unit:4} {one.verdict:5} {one.text}"
                     for one in items)


def compressed(image: pathlib.Path) -> int:
    """Bytes of the compressed image."""
    return int(run(["sh", "-c", 'xz -6 --stdout "$1" | wc -c', "sh", image]))


def _free_in_lists(zones: str) -> int:
    """Pages that are free, but in lists of single processors, which MemAvailable leaves out; from /proc/zoneinfo."""
    return sum(map(int, re.findall(r"^ +count: (\d+)$", zones, re.M)))


def boot_memory(guest: Robot) -> re.Match[str]:
    """The kernel's line about its memory; [1]: KiB of the whole machine."""
    found = re.search(r"Memory: \d+K/(\d+)K available.*", guest.sh("dmesg"))
    assert found
    return found


def meminfo(guest: Robot) -> dict[str, int]:
    """KiB of /proc/meminfo by name."""
    return {name: int(kilobytes) for name, kilobytes in
            re.findall(r"^(\w+):\s+(\d+) kB$", guest.sh("cat /proc/meminfo"), re.M)}


def memory(guest: Robot) -> float:
    """MiB of the system's memory that are neither free, nor available, nor frames in the store."""
    whole, available = int(boot_memory(guest)[1]), meminfo(guest)["MemAvailable"]
    frames = json.loads(guest.sh("ddxctl list --json"))["bytes"]
    free = _free_in_lists(guest.sh("cat /proc/zoneinfo")) * PAGE
    return (whole - available) / 1024 - (float(frames) + free) / MIB


@dataclasses.dataclass(frozen=True)
class Step:
    """A script of the boot: its start, its duration, and how long the processors had been idle when it began (s)."""
    name: str
    begin: float
    took: float
    idle: float


@dataclasses.dataclass(frozen=True)
class Timeline:
    """A boot of a machine with one processor: seconds since the kernel's start."""
    steps: list[Step]       # the critical path
    first_frame: float
    source: tuple[float, float]  # when the program began that writes the first frame, and the idle time until then

    def values(self) -> dict[str, float]:
        first = self.steps[0]
        begun, idle = self.source
        return {"first_frame": self.first_frame, "start": max(step.took for step in self.steps),
                "kernel_work": first.begin - first.idle,
                # The source waits for nothing, so that all idle time lies before its start.
                "user_work": self.first_frame - first.begin - (idle - first.idle)}

    def table(self) -> str:
        lines = [f"{step.begin:7.2f} s  {step.name:18} {step.took:5.2f} s" for step in self.steps]
        lines += [f"{self.source[0]:7.2f} s  the source begins", f"{self.first_frame:7.2f} s  first frame"]
        return "\n".join(lines)


def timeline(guest: Robot, source: str, first_frame: float) -> Timeline:
    """`source`: the service that writes the first frame."""
    steps = []
    for line in guest.sh("cat /run/log/boot").splitlines():
        begin, end, _, name, idle = line.split()
        steps.append(Step(name, float(begin), float(end) - float(begin), float(idle)))
    begun, idle = guest.sh(f"cat /run/service/{source}/begin").split()
    return Timeline(steps, first_frame, (float(begun), float(idle)))
