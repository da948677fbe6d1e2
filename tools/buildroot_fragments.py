#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""Did a kernel get what its fragments asked for? usage: buildroot_fragments.py CONFIG FRAGMENT...

Kconfig silently drops an option whose dependencies are off. Later fragments win; =m is satisfied by y as well, since
something else may need it built in. Exit status 1 and one line for each option that was dropped.
Called by Buildroot in the middle of a build: needs nothing but Python.
"""
import pathlib
import re
import sys

SET = re.compile(r"(CONFIG_\w+)=(.*)")
UNSET = re.compile(r"# (CONFIG_\w+) is not set")


def options(path: pathlib.Path) -> dict[str, str]:
    """What a configuration or a fragment says; `not set` is n."""
    found: dict[str, str] = {}
    for number, line in enumerate(path.read_text().splitlines(), 1):
        if match := SET.fullmatch(line):
            found[match[1]] = match[2]
        elif match := UNSET.fullmatch(line):
            found[match[1]] = "n"
        elif line and not line.startswith("#"):
            raise ValueError(f"{path}:{number}: not a kernel option: {line}")
    return found


def dropped(config: dict[str, str], fragments: list[pathlib.Path]) -> list[str]:
    """One line for each option that has another value than the last fragment that names it wanted."""
    wanted: dict[str, tuple[str, pathlib.Path]] = {}
    for path in fragments:
        wanted |= {name: (value, path) for name, value in options(path).items()}
    lines = []
    for name, (value, path) in wanted.items():
        have = config.get(name, "n")
        if have != value and (value, have) != ("m", "y"):
            lines.append(f"{path.parent.name}/{path.name}: {name}={value} was wanted, the kernel has {have}")
    return lines


def main() -> int:
    if len(sys.argv) < 3:
        print(__doc__, file=sys.stderr)
        return 2
    lines = dropped(options(pathlib.Path(sys.argv[1])), [pathlib.Path(name) for name in sys.argv[2:]])
    for line in lines:
        print(line, file=sys.stderr)
    return 1 if lines else 0


if __name__ == "__main__":
    sys.exit(main())
