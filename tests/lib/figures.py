# SPDX-License-Identifier: GPL-2.0-or-later
"""Figures of long tests go to output/long/<board>.jsonl, and from there to output/results.md."""
from collections.abc import Callable

from parts.guest.qemu import Guest

Figure = Callable[[str, object], None]  # pytest's record_property: a name and a JSON value


def uptime(guest: Guest) -> float:
    """The guest's uptime in s."""
    return float(guest.sh("read up rest < /proc/uptime; echo $up"))
