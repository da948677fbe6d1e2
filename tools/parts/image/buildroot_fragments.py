# SPDX-License-Identifier: GPL-2.0-or-later
"""Check that a kernel has the options of its fragments. usage:
python3 -m parts.image.buildroot_fragments CONFIG FRAGMENT...

Kconfig silently drops an option whose dependencies are off. Later fragments win; y satisfies =m, since another option
may need it built in. Prints each dropped option; the exit status is 1 if there is one.
Buildroot calls this during a build: it needs only Python.
"""
import pathlib
import re
import sys

SET = re.compile(r"(CONFIG_\w+)=(.*)")
UNSET = re.compile(r"# (CONFIG_\w+) is not set")


def options(path: pathlib.Path) -> dict[str, str]:
    """The options of a configuration or a fragment; `not set` is n."""
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
    """One line for each option whose value differs from that in the last fragment with the option."""
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
