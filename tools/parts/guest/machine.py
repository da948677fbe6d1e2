# SPDX-License-Identifier: GPL-2.0-or-later
"""The machine that boots a board's image: board/<board>/meta names machine, processor and firmware."""
import dataclasses
import os
import pathlib
import shutil

from parts import trees
from parts.common import OUTPUT, Failed, entries, fingerprint

NEEDS = ("qemu-system-i386", "qemu-system-x86_64")  # which the boards' meta files name
DEV = "dev"  # the development image; Buildroot builds all others
OVMF = pathlib.Path("/usr/share/OVMF")
# QEMU's devices for a disk on each bus; the last one is the disk itself (drive=).
BUSES = {
    "virtio": ["virtio-blk-pci"],
    "ide": ["ide-hd,bus=ide.0"],
    "ahci": ["ich9-ahci,id=ahci", "ide-hd,bus=ahci.0"],
    "usb": ["qemu-xhci,id=xhci", "usb-storage,bus=xhci.0"],
    "nvme": ["nvme,serial=ddx"],
    "sd": ["sdhci-pci", "sd-card"],
}


def meta(board: str) -> dict[str, str]:
    known = trees.boards()
    if board not in known:
        raise Failed(f"no board {board!r}; there are: {' '.join(sorted(known))}")
    return dict(line.split("=", 1) for line in entries(known[board] / "meta"))


@dataclasses.dataclass(frozen=True)
class Machine:
    board: str
    program: str
    kind: str  # pc: IDE, ISA, 1996; q35: AHCI, PCIe, 2009
    cpu: str
    memory: int  # MiB
    firmware: str = "bios"  # bios (SeaBIOS) or uefi (OVMF)
    bus: str = "virtio"  # of its disk, from BUSES

    def disk(self, drive: str) -> list[str]:
        """QEMU's options for the boot disk."""
        *others, last = BUSES[self.bus]
        return [word for device in [*others, f"{last},drive={drive}"] for word in ("-device", device)]

    def arguments(self, folder: pathlib.Path, more_memory: int = 0) -> list[str]:
        """QEMU's program and its options; the folder gets the firmware's settings."""
        kind = "pc" if self.bus == "ide" else self.kind  # q35 has no such controller
        words = [self.program, "-machine", kind, "-cpu", self.cpu, "-m", str(self.memory + more_memory)]
        if self.firmware == "uefi":
            shutil.copy(OVMF / "OVMF_VARS_4M.fd", folder / "vars.fd")
            words += ["-drive", f"if=pflash,unit=0,format=raw,readonly=on,file={OVMF}/OVMF_CODE_4M.fd",
                      "-drive", f"if=pflash,unit=1,format=raw,file={folder}/vars.fd"]
        return words


def machines(board: str) -> list[Machine]:
    """A machine for each firmware that must boot the board's image; FIRMWARE= chooses one."""
    about = meta(board)
    wanted = os.environ.get("FIRMWARE")
    names = about["firmware"].split()
    if wanted and wanted not in names:
        raise Failed(f"board {board} is tested with {' and '.join(names)}, not with {wanted}")
    return [Machine(board, about["qemu"], about["machine"], about["cpu"], int(about["memory"]), name)
            for name in names if not wanted or name == wanted]


def sources(board: str) -> str:
    """A hash over all sources for a board's image, of our tree and of other trees."""
    return fingerprint(trees.sources(board))


def image(board: str) -> pathlib.Path:
    """The product's image; fails if it is not built from the present sources."""
    meta(board)
    path = OUTPUT / board / "disk.img"
    if not path.exists():
        raise Failed(f"there is no image for {board}; `make image BOARD={board}` builds it, in about an hour")
    if (path.parent / "sources").read_text() != sources(board):
        raise Failed(f"the image for {board} is older than its sources, or made with another EXTERNAL; "
                     f"`make image BOARD={board}` renews it")
    return path
