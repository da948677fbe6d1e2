# SPDX-License-Identifier: GPL-2.0-or-later
"""Size, memory and boot time of an image, compared with the budget."""
import dataclasses
import json
import pathlib
import re

from parts.common import TOP, entries, run
from parts.guest.qemu import Guest

BUDGET = TOP / "board/common/budget.txt"
NEAR = 0.9
MIB = 1 << 20


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


def judge(values: dict[str, float]) -> list[Item]:
    """The budget's lines with a measured value."""
    items = []
    for line in entries(BUDGET):
        name, limit, unit, text = line.split(None, 3)
        if name not in values:
            continue
        items.append(Item(name, round(values[name], 2), float(limit), unit, text))
    return items


def table(items: list[Item]) -> str:
    return "\n".join(f"{one.name:12} {one.value:8.2f} of {one.limit:4.0f} {one.unit:4} {one.verdict:5} {one.text}"
                     for one in items)


def compressed(image: pathlib.Path) -> int:
    """Bytes of the compressed image."""
    return int(run(["sh", "-c", 'xz -6 -T2 --stdout "$1" | wc -c', "sh", image]))


def memory(guest: Guest) -> float:
    """MiB of the system's memory that are neither available nor frames in the store."""
    found = re.search(r"Memory: \d+K/(\d+)K available", guest.sh("dmesg"))
    assert found
    kilobytes = {name: int(value) for name, value in re.findall(r"^(\w+):\s+(\d+) kB$", guest.sh("cat /proc/meminfo"),
                                                               re.M)}
    frames = json.loads(guest.sh("ddxctl list --json"))["bytes"]
    return (int(found[1]) - kilobytes["MemAvailable"]) / 1024 - float(frames) / MIB


def starts(guest: Guest) -> list[tuple[str, float, float]]:
    """The boot's critical path: each script, its start and its duration (s)."""
    found = []
    for line in guest.sh("cat /run/log/boot").splitlines():
        begin, end, _, name = line.split()
        found.append((name, float(begin), float(end) - float(begin)))
    return found


def path(found: list[tuple[str, float, float]], first_frame: float) -> str:
    lines = [f"{begin:7.2f} s  {name:18} {took:5.2f} s" for name, begin, took in found]
    return "\n".join([*lines, f"{first_frame:7.2f} s  first frame"])
