#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""Build the programs, and the development image: build.py [desk|dev|foreign]

foreign: only the third-party parts of the image (kernel, BusyBox, FFmpeg), which can be built beside the programs.
"""
import os
import pathlib
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

from parts import trees
from parts.common import OUTPUT, TOP, Failed, alone, commit, finish, fingerprint, run, say, step
from parts.guest import machine
from parts.image import busybox, ffmpeg, kernel, native, rootfs, tables
from parts.release import update_file

DEV = OUTPUT / "dev"
UPDATE_KEY = OUTPUT / "update/dev.key"
RUN = OUTPUT / "run/dev"  # the image for `make run`, without catalog and FireWire cameras


def foreign() -> tuple[pathlib.Path, pathlib.Path, pathlib.Path]:
    """Build the third-party parts: kernel, BusyBox, FFmpeg. Side by side, since each has pieces that keep only one
    processor busy, such as downloads and configure scripts."""
    with alone("build", OUTPUT / "foreign.lock"), ThreadPoolExecutor() as pool:
        parts = [pool.submit(part) for part in (ffmpeg.ffmpeg, busybox.busybox, kernel.kernel)]  # the longest first
        codecs, busybox_folder, kernel_folder = [part.result() for part in parts]
        return kernel_folder, busybox_folder, codecs


def for_run() -> pathlib.Path:
    """The image for `make run`: third-party parts are built while packages are installed that only other steps need."""
    beside = subprocess.Popen([sys.executable, "-B", __file__, "foreign"], stdin=subprocess.DEVNULL,
                              start_new_session=True)
    try:
        if subprocess.run([TOP / "tools/setup", "run"], check=False).returncode:
            raise Failed("not all packages could be installed, see above")
        programs = native.for_run()
        if beside.wait():
            raise Failed("a third-party part could not be built, see above")
    finally:
        if beside.poll() is None:
            os.killpg(beside.pid, signal.SIGTERM)
            beside.wait()
    return dev([programs], RUN)


def update_words() -> dict[str, str]:
    """For post-build.sh: serials, and the keys of updates; without UPDATE_KEYS the development image trusts a key that
    its first build makes, without a password."""
    keys = trees.update_keys()
    if not keys:
        public = UPDATE_KEY.with_name(UPDATE_KEY.name + ".pub")
        keys = [public if public.exists() else update_file.make_key(UPDATE_KEY, "-W")]
    return trees.update_words(keys)


def dev(packages: list[pathlib.Path], folder: pathlib.Path = DEV) -> pathlib.Path:
    """The development image in that folder; `packages` are install trees."""
    tools = pathlib.Path(__file__).parent
    kernel_folder, busybox_folder, codecs = foreign()
    root = folder / "root"

    def make_root() -> None:
        rootfs.assemble(root, busybox_folder, kernel_folder, [*packages, codecs], words)
        shell = root / "bin/busybox"
        (root / "boot/vmlinuz").write_bytes((kernel_folder / "boot/vmlinuz").read_bytes())
        kernel.initramfs(kernel_folder, shell, rootfs.libraries(shell, []), root / "boot/initrd")
        rootfs.pack(root, folder / "rootfs.squashfs")

    def make_disk() -> None:
        run([TOP / "board/common/post-image.sh"], env={"BINARIES_DIR": str(folder)})

    with alone("build", UPDATE_KEY.with_suffix(".lock")):
        words = update_words()
    parts = tools / "parts/image"
    key = fingerprint([tools / "build.py", parts / "rootfs.py", parts / "tables.py", parts / "kernel.py",
                       *trees.each("overlay"), TOP / "board/dev", TOP / "board/common/post-build.sh",
                       TOP / "board/common/boot-files.txt", *tables.tables(),
                       *map(pathlib.Path, words["UPDATE_KEYS"].split()), DEV / "kernel.stamp", *packages],
                      busybox_folder.name, codecs.name, commit(), words["DDX_SERIAL"], words["DDX_OLDEST"])
    with alone("build", folder.with_suffix(".lock")):  # parallel tests all call this
        step("root file system", folder / "root.stamp", key, make_root)
        step("disk", folder / "disk.stamp", fingerprint([TOP / "board/common"], key), make_disk)
    return folder / "disk.img"


def images(board: str) -> tuple[pathlib.Path, pathlib.Path]:
    """The board's image, and the development image, with which QEMU's acceleration is tried. A board that Buildroot has
    not built is refused before anything is built here."""
    product = None if board == machine.DEV else machine.image(board)
    development = dev([native.build()])
    return product or development, development


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
