#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""Build the programs, and the development image: build.py [desk|dev]"""
import pathlib
import sys

import busybox
import native
import kernel
import rootfs
from common import OUTPUT, TOP, Failed, fingerprint, run, say, step

DEV = OUTPUT / "dev"
IMAGE = DEV / "disk.img"


def dev(packages: list[pathlib.Path]) -> pathlib.Path:
    """The development image; `packages` are install trees."""
    tools = pathlib.Path(__file__).parent
    kernel_folder = kernel.kernel()
    busybox_folder = busybox.busybox()
    root = DEV / "root"

    def make_root() -> None:
        rootfs.assemble(root, busybox_folder, kernel_folder, packages)
        shell = root / "bin/busybox"
        (root / "boot/vmlinuz").write_bytes((kernel_folder / "boot/vmlinuz").read_bytes())
        kernel.initramfs(kernel_folder, shell, rootfs.libraries(shell, []), root / "boot/initrd")
        rootfs.pack(root, DEV / "rootfs.squashfs")

    def make_disk() -> None:
        run([TOP / "board/common/post-image.sh"], env={"BINARIES_DIR": str(DEV)})

    key = fingerprint([tools / "build.py", tools / "rootfs.py", tools / "kernel.py", TOP / "overlay", TOP / "board/dev",
                       TOP / "board/common/users.txt", TOP / "board/common/post-build.sh", DEV / "kernel.stamp",
                       DEV / "busybox.stamp", *packages])
    step("root file system", DEV / "root.stamp", key, make_root)
    step("disk", DEV / "disk.stamp", fingerprint([TOP / "board/common"], key), make_disk)
    return IMAGE


def main() -> int:
    what = sys.argv[1] if len(sys.argv) > 1 else "dev"
    try:
        packages = native.build()
        if what == "dev":
            say(f"image: {dev([packages]).relative_to(TOP)}")
    except Failed as error:
        say(f"build: {error}")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
