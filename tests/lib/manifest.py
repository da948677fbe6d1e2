# SPDX-License-Identifier: GPL-2.0-or-later
"""Compare an image (unpacked root, kernel configuration, disk) with board/common/manifest.txt of each tree."""
import pathlib
import re

from parts import trees
from parts.common import entries, run
from parts.disk import mbr
from parts.image import tables

MANIFEST = "board/common/manifest.txt"


def lines() -> list[str]:
    """The lines of the manifests, and those for users and services from the tables of programs."""
    return [*(line for path in trees.each(MANIFEST) for line in entries(path)),
            *(f"user {one.user} {one.number} {tables.GROUP}" for one in tables.programs()),
            *(f"service {script}" for script in tables.scripts())]


def wanted(kind: str) -> list[list[str]]:
    return [line.split()[1:] for line in lines() if line.split()[0] == kind]


def _words(kind: str) -> list[str]:
    return [word for words in wanted(kind) for word in words]


def ports(found: set[tuple[str, int, str]]) -> list[str]:
    """Open ports (kind, number, program) that are not listed, and listed ones that are not open. A range stands for one
    port in it."""
    left, bad = set(found), []
    for kind, numbers, program in wanted("port"):
        first, _, last = numbers.partition("-")
        fitting = [one for one in left if one[0] == kind and one[2] in ("", program)
                   and int(first) <= one[1] <= int(last or first)]
        left -= set(fitting[:1])
        if not fitting:
            bad.append(f"no {kind} {numbers} {program}")
    return bad + [f"unlisted {kind} {number} {program}" for kind, number, program in sorted(left)]


def applets(root: pathlib.Path) -> list[str]:
    """Listed applets without a link to BusyBox in the root, and links that are not listed."""
    present = {path.name for folder in ["bin", "sbin", "usr/bin", "usr/sbin"] for path in (root / folder).glob("*")
               if path.is_symlink() and path.readlink().name == "busybox"}
    listed = set(_words("applet"))
    return [*(f"no {name}" for name in sorted(listed - present)),
            *(f"unlisted {name}" for name in sorted(present - listed))]


def programs(root: pathlib.Path) -> list[str]:
    """Programs that are missing or are applets of BusyBox. A program may be a link to another, like Dropbear's scp."""
    found = {words[0]: root / words[0].lstrip("/") for words in wanted("program")}
    return [name for name, path in found.items()
            if not path.is_file() or (path.is_symlink() and path.readlink().name == "busybox")]


def kernel(config: pathlib.Path) -> list[str]:
    enabled = set(re.findall(r"^(CONFIG_\w+)=[ym]$", config.read_text(), re.M))
    return sorted(set(_words("kernel")) - enabled)


def modules(root: pathlib.Path) -> list[str]:
    folder = next((root / "lib/modules").iterdir())
    text = (folder / "modules.dep").read_text() + (folder / "modules.builtin").read_text()
    present = {name.replace("-", "_") for name in re.findall(r"([\w-]+)\.ko", text)}
    return sorted(set(_words("module")) - present)


def accounts(root: pathlib.Path) -> list[str]:
    """Groups and users that are missing or have other numbers, and unknown users in our range."""
    groups = {line.split(":")[0]: line.split(":")[2] for line in (root / "etc/group").read_text().splitlines()}
    users = {line.split(":")[0]: line.split(":")[2:4] for line in (root / "etc/passwd").read_text().splitlines()}
    bad = [f"group {name} {number}" for name, number in wanted("group") if groups.get(name) != number]
    bad += [f"user {name} {number} {group}" for name, number, group in wanted("user")
            if users.get(name) != [number, groups.get(group)]]
    known = {words[0] for words in wanted("user")}
    bad += [f"unknown user {name}" for name, (number, _) in users.items()
            if 900 <= int(number) < 1000 and name not in known]
    return bad


def services(root: pathlib.Path) -> tuple[list[str], list[str]]:
    """The init scripts in order: wanted, and present."""
    return sorted(_words("service")), sorted(path.name for path in (root / "etc/init.d").glob("S*"))


def disk(image: pathlib.Path) -> list[str]:
    """Differences of the partition table and the labels."""
    table = mbr.table(image)
    bad = [] if table["id"] == f"0x{wanted('disk')[0][1]}" else [f"signature {table['id']}"]
    found = {entry["number"]: entry for entry in table["partitions"]}
    for number, kind, start, size, label in wanted("partition"):
        entry = found.pop(int(number), None)
        if (entry is None or entry["type"] != kind or entry["start"] != int(start)
                or int(size) not in (0, entry["size"])):
            bad.append(f"partition {number}: {entry}")
        elif label != "-":
            offset = str(entry["start"] * 512)
            found_label = run(["blkid", "-p", "-s", "LABEL", "-o", "value", "-O", offset, image]).strip()
            if found_label != label:
                bad.append(f"partition {number}: label {found_label}")
    return bad + [f"unknown partition {number}" for number in found]
