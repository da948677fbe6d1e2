# SPDX-License-Identifier: GPL-2.0-or-later
"""The partitions of an MBR disk, in a file or on a device."""
import dataclasses
import json
import os
import pathlib
import subprocess
from typing import Any

from parts.common import SBIN, Failed

EXTENDED = ("5", "f", "85")


@dataclasses.dataclass(frozen=True)
class Partition:
    number: int
    begin: int  # in bytes
    end: int


def table(disk: pathlib.Path) -> dict[str, Any]:
    """The disk's signature (`id`) and its partitions, as sfdisk describes them."""
    done = subprocess.run(["sfdisk", "--json", disk], env={**os.environ, **SBIN}, stdin=subprocess.DEVNULL,
                          capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise Failed(f"{disk}: no partition table: {done.stderr.strip()}")
    found: dict[str, Any] = json.loads(done.stdout)["partitiontable"]
    for entry in found["partitions"]:
        entry["number"] = int(entry["node"].removeprefix(found["device"]).lstrip("p"))
    return found


def partitions(disk: pathlib.Path) -> list[Partition]:
    """All partitions except the extended one, which contains the logical ones (5 and up)."""
    found = table(disk)
    size = found["sectorsize"]
    return [Partition(one["number"], one["start"] * size, (one["start"] + one["size"]) * size)
            for one in found["partitions"] if one["type"] not in EXTENDED]


def partition(disk: pathlib.Path, number: int) -> Partition:
    for one in partitions(disk):
        if one.number == number:
            return one
    raise Failed(f"{disk}: no partition {number}")
