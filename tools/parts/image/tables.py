# SPDX-License-Identifier: GPL-2.0-or-later
"""The packages' tables of programs, package/*/programs.txt: services and their users."""
import dataclasses
import pathlib
import re

from parts import trees
from parts.common import BadInput, entries

GROUP, GROUP_NUMBER = "ddx", 900
LINE = re.compile(r"\S+\s+(S\d\d\w[\w-]*|-)\s+(?:([a-z][a-z0-9_-]*)\s+(9(?!00)\d\d)|-\s+-)\s+(\S[^:]*)", re.ASCII)
# Users of the base systems: a second line of that name would count as the first one, so a service would run as root.
BASE = ["root", "daemon", "bin", "sys", "sync", "mail", "www-data", "operator", "nobody", "dbus", "sshd"]


@dataclasses.dataclass(frozen=True)
class Program:
    script: str  # its init script's name; "-": another program starts it
    user: str
    number: str
    what: str
    table: pathlib.Path

    def names(self) -> list[tuple[str, str]]:
        """Names and numbers that must be unique."""
        script = [] if self.script == "-" else [("service", self.script[3:])]
        return [*script, ("user", self.user), ("number", self.number)]


def tables() -> list[pathlib.Path]:
    """The tables of all trees' packages."""
    paths = [folder / "programs.txt" for folder in trees.packages().values()]
    return [path for path in paths if path.exists()]


def _lines(table: pathlib.Path) -> list[Program]:
    found = [(line, LINE.fullmatch(line)) for line in entries(table)]
    for line, words in found:
        if not words:
            raise BadInput(f"{table}: {line!r}: needed are folder, init script, user, number from 901 to 999, purpose")
    return [Program(words[1], words[2], words[3], words[4], table) for _, words in found if words and words[2]]


def programs() -> list[Program]:
    """All programs with their own user, by the users' numbers."""
    found = [one for table in tables() for one in _lines(table)]
    taken = {("user", name): pathlib.Path("/etc/passwd") for name in BASE}
    for one in found:
        for kind, word in one.names():
            if (kind, word) in taken:
                raise BadInput(f"{one.table}: the {kind} {word} is in {taken[kind, word]} already; choose another one")
            taken[kind, word] = one.table
    return sorted(found, key=lambda one: one.number)


def scripts() -> list[str]:
    """Names of init scripts, in the order in which they run."""
    return sorted(one.script for one in programs() if one.script != "-")


def services() -> list[str]:
    """The programs' names, in the order in which they start: `ddxctl services`."""
    return [name[3:] for name in scripts()]
