#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""Build the programs, and the development image: build.py [desk|dev|foreign]

foreign: only the third-party parts of the image (kernel, BusyBox, FFmpeg), which can be built beside the programs.
"""
import pathlib
import sys

from parts import trees
from parts.common import OUTPUT, TOP, alone, commit, finish, fingerprint, run, say, step
from parts.image import busybox, ffmpeg, kernel, native, rootfs, tables

DEV = OUTPUT / "dev"
IMAGE = DEV / "disk.img"


def foreign() -> tuple[pathlib.Path, pathlib.Path, pathlib.Path]:
    """Build the third-party parts: kernel, BusyBox, FFmpeg."""
    with alone("build", OUTPUT / "foreign.lock"):
        return kernel.kernel(), busybox.busybox(), ffmpeg.ffmpeg()


def dev(packages: list[pathlib.Path]) -> pathlib.Path:
    """The development image; `packages` are install trees."""
    tools = pathlib.Path(__file__).parent
    kernel_folder, busybox_folder, codecs = foreign()
    root = DEV / "root"

    def make_root() -> None:
        rootfs.assemble(root, busybox_folder, kernel_folder, [*packages, codecs])
        shell = root / "bin/busybox"
        (root / "boot/vmlinuz").write_bytes((kernel_folder / "boot/vmlinuz").read_bytes())
        kernel.initramfs(kernel_folder, shell, rootfs.libraries(shell, []), root / "boot/initrd")
        rootfs.pack(root, DEV / "rootfs.squashfs")

    def make_disk() -> None:
        run([TOP / "board/common/post-image.sh"], env={"BINARIES_DIR": str(DEV)})

    parts = tools / "parts/image"
    key = fingerprint([tools / "build.py", parts / "rootfs.py", parts / "tables.py", parts / "kernel.py",
                       *trees.each("overlay"), TOP / "board/dev", TOP / "board/common/post-build.sh", *tables.tables(),
                       DEV / "kernel.stamp", *packages], busybox_folder.name, codecs.name,
                      commit())
    with alone("build", OUTPUT / "dev.lock"):  # parallel tests all call this
        step("root file system", DEV / "root.stamp", key, make_root)
        step("disk", DEV / "disk.stamp", fingerprint([TOP / "board/common"], key), make_disk)
    return IMAGE


def main() -> int:
    what = sys.argv[1] if len(sys.argv) > 1 else "dev"
    if what == "foreign":
        foreign()
        return 0
    tables.programs()  # refuses contradictory tables before anything is built
    packages = native.build()
    if what == "dev":
        say(f"image: {dev([packages]).relative_to(TOP)}")
    return 0


if __name__ == "__main__":
    finish("build", main)
