# SPDX-License-Identifier: GPL-2.0-or-later
"""A disk of this machine: its description, its contents, and reasons not to overwrite it."""
import dataclasses
import os
import pathlib
import re
import stat

from parts.common import Failed, output

SYS = pathlib.Path("/sys")
PROC = pathlib.Path("/proc")
SYSTEM = ("/", "/usr", "/boot", "/boot/efi", "/boot/firmware", "/run/live/medium", "/cdrom")  # needed by this system


def amount(size: int) -> str:
    """Bytes as they are printed on the disk: 7.9 GB."""
    return f"{size / 1e9:.1f} GB" if size >= 1e9 else f"{size / 1e6:.1f} MB"


def _word(path: pathlib.Path) -> str:
    try:
        return path.read_text(errors="replace").strip()
    except OSError:
        return ""


def _folder(number: str) -> pathlib.Path:
    """The kernel's folder of a block device, by its number (8:0)."""
    return (SYS / "dev/block" / number).resolve()


def _number(path: str | os.PathLike[str]) -> str:
    """A block device's number; empty if this is no block device."""
    try:
        found = os.stat(path)
    except OSError:
        return ""
    return f"{os.major(found.st_rdev)}:{os.minor(found.st_rdev)}" if stat.S_ISBLK(found.st_mode) else ""


@dataclasses.dataclass(frozen=True)
class Mount:
    numbers: tuple[str, str]  # the file system's own, and its source's: they differ with btrfs
    where: str


def _plain(text: str) -> str:
    return re.sub(r"\\([0-7]{3})", lambda match: chr(int(match[1], 8)), text)


def _mounts() -> list[Mount]:
    found = []
    for line in _word(PROC / "self/mountinfo").splitlines():
        words = line.split()
        source = words[words.index("-") + 2]
        found.append(Mount((words[2], _number(_plain(source)) if source.startswith("/") else ""), _plain(words[4])))
    return found


def _below(number: str, seen: set[str]) -> None:
    """Collect the names of the device, its disk, and all devices below them."""
    folder = _folder(number)
    if not (folder / "dev").exists() or folder.name in seen:
        return
    seen.add(folder.name)
    if (folder / "partition").exists():
        _below(_word(folder.parent / "dev"), seen)
    for slave in (folder / "slaves").glob("*"):
        _below(_word(slave / "dev"), seen)
    if backing := _word(folder / "loop/backing_file"):
        try:
            device = os.stat(backing).st_dev
        except OSError:
            return
        _below(_number(backing) or f"{os.major(device)}:{os.minor(device)}", seen)


def system_disks() -> set[str]:
    """The names of all disks that the running system uses."""
    seen: set[str] = set()
    for mount in _mounts():
        if mount.where in SYSTEM:
            for number in filter(None, mount.numbers):
                _below(number, seen)
    return seen


def loops_on(path: pathlib.Path) -> list[str]:
    """Loop devices on this file or device."""
    found = []
    for folder in sorted((SYS / "block").glob("loop*")):
        try:
            if os.path.samefile(_word(folder / "loop/backing_file"), path):
                found.append(folder.name)
        except OSError:
            pass
    return found


class TargetDisk:
    """A whole disk; refuses anything else."""

    def __init__(self, path: pathlib.Path) -> None:
        if not path.exists():
            raise Failed(f"{path}: there is no such device")
        number = _number(path)
        if not number:
            raise Failed(f"{path} is not a block device")
        self.path = path = path.resolve()  # partitions are beside this path, not beside /dev/disk/by-id/...
        self.folder = _folder(number)
        if (self.folder / "partition").exists():
            raise Failed(f"{path} is a partition; name the whole disk, {path.parent / self.folder.parent.name}")
        for kind, title in [("dm", "device-mapper volume"), ("md", "RAID")]:
            if (self.folder / kind).exists():
                raise Failed(f"{path} is a {title}; name a real disk")

    @property
    def size(self) -> int:
        return int(_word(self.folder / "size") or 0) * 512

    def title(self) -> str:
        """One line: /dev/sdb: Generic SD/MMC, 7.9 GB, removable."""
        model = " ".join(filter(None, (_word(self.folder / "device" / name) for name in ("vendor", "model", "name"))))
        backing = _word(self.folder / "loop/backing_file")
        words = [model or (f"loop device on {backing}" if backing else "model unknown"), amount(self.size)]
        words += ["removable"] if _word(self.folder / "removable") == "1" else []
        return f"{self.path}: {', '.join(words)}"

    def contents(self) -> list[str]:
        """A line for each partition: number, size, file system and label."""
        text = output(["partx", "--raw", "--noheadings", "--output", "NR,START,SECTORS,TYPE", self.path])
        found = []
        for number, first, count, kind in [row.split() for row in text.splitlines() if len(row.split()) == 4]:
            if kind in ("0x5", "0xf", "0x85"):  # extended: its partitions are listed themselves
                continue
            what = self._file_system("--offset", str(int(first) * 512), "--size", str(int(count) * 512))
            found.append(f"partition {number}: {amount(int(count) * 512)}, {what or 'unknown content'}")
        if not found and (what := self._file_system()):
            found.append(f"no partitions: {what}")
        return found or ["no known content" if os.access(self.path, os.R_OK) else "(contents: readable by root only)"]

    def _file_system(self, *options: str) -> str:
        text = output(["blkid", "--probe", "--output", "export", *options, self.path])
        words = dict(line.split("=", 1) for line in text.splitlines() if "=" in line)
        kind = words.get("TYPE") or (f"{words['PTTYPE']} table" if "PTTYPE" in words else "")
        return " ".join(filter(None, [kind, words.get("LABEL", "")]))

    def refuse(self, need: int) -> None:
        """Fail, with the reason, unless the disk can be overwritten with `need` bytes."""
        partitions = sorted(file.parent for file in self.folder.glob("*/partition"))
        nodes = {_word(node / "dev"): node for node in [self.folder, *partitions]}
        if self.folder.name in system_disks():
            raise Failed(f"{self.path} is the disk that this system runs from")
        for mount in _mounts():
            for number in mount.numbers:
                if number in nodes:
                    device = self.path.parent / nodes[number].name
                    raise Failed(f"{device} is mounted on {mount.where}; unmount it first")
        for line in _word(PROC / "swaps").splitlines()[1:]:
            if (number := _number(_plain(line.split()[0]))) in nodes:
                raise Failed(f"{self.path.parent / nodes[number].name} is in use as swap; swapoff it first")
        for node in nodes.values():
            device = self.path.parent / node.name
            for holder in sorted((node / "holders").glob("*")):
                name = _word(holder / "dm/name") or holder.name
                raise Failed(f"{device} is part of {name} (LVM, RAID or encryption); stop that first")
            for loop in loops_on(device):
                raise Failed(f"{device} is in use by /dev/{loop}; losetup -d it first")
        if self.size == 0:
            raise Failed(f"{self.path} is empty: no card in the reader?")
        if _word(self.folder / "ro") == "1":
            raise Failed(f"{self.path} is read-only; does the card have a lock?")
        sector = _word(self.folder / "queue/logical_block_size")
        if sector not in ("", "512"):
            raise Failed(f"{self.path} has sectors of {sector} bytes; the image's partition table is made for 512")
        if self.size < need:
            raise Failed(f"{self.path} is too small: it has {self.size:,} bytes, the image needs {need:,}")
