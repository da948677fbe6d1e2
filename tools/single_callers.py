#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""List C modules that fit into their only caller: those without a unit test of their own, where both together have
fewer than 500 lines. single_callers.py [FOLDER below package/]

A module is a source file, a header, or both with one name in one folder. It has a unit test if a file of tests/ or
bench/ includes its header, or if tests/meson.build has its source in a test.
"""
import collections
import pathlib
import re
import sys

from parts.common import TOP, say

LIMIT = 500  # lines
WHOLE = {"encoder", "lib_sources", "store_parts", "store_shared"}  # all of a library or program
Module = tuple[pathlib.Path, str]  # folder and name


def included(path: pathlib.Path) -> list[str]:
    return re.findall(r'^ *# *include [<"](?:\.\.[\w./]*/)?(\w+)\.h[>"]', path.read_text(), re.MULTILINE)


def tested(top: pathlib.Path) -> set[str]:
    """Names of modules that tests and benchmarks use directly."""
    names = {name for folder in ("tests", "bench") for path in (top / folder).rglob("*.[ch]")
             for name in included(path)}
    tests = (top / "tests/meson.build").read_text()
    names |= set(re.findall(r"(\w+)\.c'", tests))
    for path in top.glob("package/**/meson.build"):  # lists of a few sources that a test has
        for listed, sources in re.findall(r"^(\w+) = files\((.*?)\)", path.read_text(), re.MULTILINE | re.DOTALL):
            if f"'{listed}'" in tests and listed not in WHOLE:
                names |= set(re.findall(r"(\w+)\.c'", sources))
    return names


def callers(top: pathlib.Path) -> tuple[dict[Module, int], dict[Module, set[Module]]]:
    """Lines of each module, and the modules that include its header."""
    lines: collections.Counter[Module] = collections.Counter()
    users: dict[Module, set[Module]] = collections.defaultdict(set)
    files = sorted(top.glob("package/**/*.[ch]"))
    homes: dict[str, set[Module]] = collections.defaultdict(set)
    for path in files:
        lines[path.parent, path.stem] += len(path.read_text().splitlines())
        homes[path.stem].add((path.parent, path.stem))
    for path in files:
        mine = (path.parent, path.stem)
        for name in included(path):
            near = {one for one in homes[name] if one[0] == path.parent} or homes[name]
            for module in near - {mine}:
                users[module].add(mine)
    return lines, users


def fitting(top: pathlib.Path) -> list[str]:
    lines, users = callers(top)
    own = tested(top)
    found = []
    for module, size in sorted(lines.items()):
        caller = next(iter(users[module]), module)
        if len(users[module]) == 1 and module[1] not in own and size + lines[caller] < LIMIT:
            found.append(f"{(module[0] / module[1]).relative_to(top)}: {size} lines, into {caller[1]}: "
                         f"{size + lines[caller]}")
    return found


def main() -> int:
    found = [line for line in fitting(TOP) if line.startswith(f"package/{''.join(sys.argv[1:2])}")]
    for line in found:
        say(line)
    say(f"single_callers: {len(callers(TOP)[0])} modules, {len(found)} of them fit into their only caller")
    return 0


if __name__ == "__main__":
    sys.exit(main())
