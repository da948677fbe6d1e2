# SPDX-License-Identifier: GPL-2.0-or-later
"""Sizes of the files of an image, and uses of its machine's memory."""
import json
import pathlib
import zlib

from lib import budget
from parts.guest.robot import Robot

BLOCK = 128 << 10  # of the squashfs
ELF = b"\x7fELF"
KERNEL = ("Slab", "SUnreclaim", "PageTables", "KernelStack", "Percpu", "AnonPages", "Shmem", "Mapped")  # in meminfo
# One line, since a guest gets the lines of a command joined by spaces.
PRIVATE = ("for one in /proc/[0-9]*; do read -r name < $one/comm && awk -v name=\"$name\" "
           "'/^Private_/ { sum += $2 } END { if (sum) print sum, name }' $one/smaps_rollup; done 2> /dev/null; true")


def _packed(data: bytes) -> int:
    """Bytes in the squashfs: each block is packed on its own, or stored as it is if that takes less."""
    blocks = [data[at:at + BLOCK] for at in range(0, len(data), BLOCK)]
    return sum(min(len(block), len(zlib.compress(block, 9))) for block in blocks)


def _kind(name: str, begin: bytes) -> str:
    if name.startswith("boot/"):
        return "kernel"
    if name.startswith("lib/modules/"):
        return "modules"
    if begin.startswith(ELF):
        return "libraries" if ".so" in pathlib.PurePath(name).name else "programs"
    return "scripts" if begin.startswith(b"#!") or name.startswith(("etc/init.d/", "usr/libexec/")) else "others"


def of_image(root: pathlib.Path) -> dict[str, dict[str, list[int]]]:
    """Bytes of each file, raw and packed, in kinds: kernel, modules, programs, libraries, scripts, others."""
    found: dict[str, dict[str, list[int]]] = {}
    seen = set()
    for path in sorted(root.rglob("*")):
        if path.is_symlink() or not path.is_file() or path.stat().st_ino in seen:
            continue
        seen.add(path.stat().st_ino)
        data, name = path.read_bytes(), str(path.relative_to(root))
        found.setdefault(_kind(name, data[:4]), {})[name] = [len(data), _packed(data)]
    return found


def of_memory(guest: Robot) -> dict[str, object]:
    """KiB: the kernel's line about its own memory, what it allocates, and the private memory of each process."""
    known = budget.meminfo(guest)
    private: dict[str, int] = {}
    for line in guest.sh(PRIVATE).splitlines():
        kilobytes, name = line.split(None, 1)
        private[name] = private.get(name, 0) + int(kilobytes)
    return {"boot": budget.boot_memory(guest)[0], "kernel": {name: known[name] for name in KERNEL},
            "private": dict(sorted(private.items(), key=lambda one: -one[1]))}


def table(image: dict[str, dict[str, list[int]]], memory: dict[str, object]) -> str:
    lines = [f"{'KiB raw':>9} {'packed':>8}"]
    for kind, files in image.items():
        raw, packed = (sum(one[column] for one in files.values()) for column in (0, 1))
        lines.append(f"{raw / 1024:9.0f} {packed / 1024:8.0f}  {kind}, {len(files)} files")
        if kind in ("programs", "libraries"):
            largest = sorted(files.items(), key=lambda one: -one[1][1])[:8]
            lines += [f"{one[0] / 1024:9.0f} {one[1] / 1024:8.0f}    {name}" for name, one in largest]
    return "\n".join([*lines, json.dumps(memory)])
