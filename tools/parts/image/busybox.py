# SPDX-License-Identifier: GPL-2.0-or-later
"""BusyBox's configuration, for both kinds of image; and the development image's, from Debian's source package.

All is off (allnoconfig) but the manifest's applets and what busybox.config lists. So no unwanted option is on,
in any version of BusyBox, and there is no second list of applets.
"""
import os
import pathlib
import re
from collections.abc import Sequence

from parts.common import TOP, Failed, entries, run
from parts.image import foreign

CONFIG = TOP / "board/common/busybox.config"
MANIFEST = TOP / "board/common/manifest.txt"
# BusyBox's sources say which option each applet belongs to: //applet:IF_BB_ARCH(APPLET_NOFORK(arch, uname, ...
APPLET = re.compile(r"^//applet:IF_(\w+)\(\s*(?:IF_\w+\(\s*)*APPLET\w*\(\s*([^\s,]+)\s*,", re.M)


def applets() -> list[str]:
    """The applets in the manifest."""
    lines = (line.split() for line in entries(MANIFEST))
    return [name for kind, *names in lines if kind == "applet" for name in names]


def options(source: pathlib.Path) -> dict[str, str]:
    """The option of each applet that this BusyBox could have; of the two for `sh`, ash's comes first."""
    found: dict[str, str] = {}
    for path in sorted(source.glob("[!.]*/**/*.c")):
        for option, name in APPLET.findall(path.read_text(errors="replace")):
            found.setdefault(name, f"CONFIG_{option}")
    return found


def configure(source: pathlib.Path, make: Sequence[str]) -> None:
    """Write source/.config; `make` is how BusyBox's make is called."""
    known, config = options(source), source / ".config"
    if unknown := [name for name in applets() if name not in known]:
        raise Failed(f"{MANIFEST.name}: BusyBox has no applet {' '.join(unknown)}")
    wanted = [*(f"{known[name]}=y" for name in applets()), *entries(CONFIG)]
    run([*make, "allnoconfig"], cwd=source)
    # Its KCONFIG_ALLCONFIG turns nothing on. Numbers and paths are left to oldconfig: those of what was off are 0 here.
    on = {line.split("=")[0] for line in wanted}
    lines = config.read_text().splitlines()
    off = [line for line in lines if line.endswith(" is not set") and line.split()[1] not in on]
    config.write_text("\n".join([*off, *wanted, ""]))
    run(["sh", "-c", 'yes "" | "$@"', "sh", *make, "oldconfig"], cwd=source)
    # Kconfig drops without a word what it does not know, and what depends on something that is off.
    if dropped := sorted(set(wanted) - set(config.read_text().splitlines())):
        raise Failed(f"BusyBox cannot have {' '.join(dropped)}")


def build(tree: pathlib.Path, sources: dict[str, pathlib.Path]) -> None:
    source = sources["busybox"]
    configure(source, ["make"])
    run(["make", f"-j{os.cpu_count()}", "busybox"], cwd=source)
    run(["make", f"CONFIG_PREFIX={tree}", "install"], cwd=source)


def busybox() -> pathlib.Path:
    """An install tree: bin/busybox and its links."""
    return foreign.built("BusyBox", ["busybox"], [CONFIG, MANIFEST, pathlib.Path(__file__)], build)
