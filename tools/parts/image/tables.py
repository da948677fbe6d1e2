# SPDX-License-Identifier: GPL-2.0-or-later
"""The packages' tables of programs, package/*/programs.txt: what runs as a service, and as whom."""
import dataclasses

from parts.common import TOP, entries

GROUP, GROUP_NUMBER = "ddx", 900
TABLES = sorted(TOP.glob("package/*/programs.txt"))


@dataclasses.dataclass(frozen=True)
class Program:
    script: str  # its init script's name; "-": others start it
    user: str
    number: str
    what: str


def programs() -> list[Program]:
    """All that have a user of their own, in the order of the users' numbers."""
    lines = [line.split(None, 4)[1:] for table in TABLES for line in entries(table)]
    return sorted((Program(*words) for words in lines if words[1] != "-"), key=lambda one: one.number)


def scripts() -> list[str]:
    """Names of init scripts, in the order in which they run."""
    return sorted(one.script for one in programs() if one.script != "-")


def services() -> list[str]:
    """The programs' names, in the order in which they start: `ddxctl services`."""
    return [name[3:] for name in scripts()]
