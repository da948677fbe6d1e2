# SPDX-License-Identifier: GPL-2.0-or-later
"""A small disk with two slots, on which ddxupdate runs as on a machine; its keys and update files."""
from __future__ import annotations

import contextlib
import os
import pathlib
import random
import subprocess
from collections.abc import Iterator

from lib import boot_block, update_cut
from lib.update_cut import BOOT, DATA, SLOTS
from parts.common import Closing, run
from parts.disk.logged_device import LoggedDevice
from parts.image import native
from parts.release import update_file
from parts.release.update_file import Release

from .programs import library_folder

RUNNING, NEW = Release("test", "1", "0.2.0 (running)", "1000"), Release("test", "1", "0.3.0 (new)", "2000")
FORMER = Release("test", "1", "0.1.0 (former)", "500")


def make_root(folder: pathlib.Path, what: Release, seed: int) -> bytes:
    """A root file system that nearly fills a slot: with a kernel of random bytes, and its version."""
    root, image = folder / f"root{seed}", folder / f"root{seed}.squashfs"
    for name in ("boot", "usr/lib"):
        (root / name).mkdir(parents=True)
    (root / "boot/vmlinuz").write_bytes(random.Random(seed).randbytes(2_900_000))
    (root / "usr/lib/os-release").write_text(
        f'VARIANT_ID={what.board}\nVERSION="{what.version}"\nDDX_LAYOUT={what.layout}\nDDX_SERIAL={what.serial}\n')
    run(["mksquashfs", root, image, "-noI", "-noD", "-noF", "-noappend", "-no-progress", "-quiet", "-all-root"])
    return image.read_bytes()


class UpdateDisk(Closing):
    """`here` runs the version RUNNING, the other slot has FORMER, or nothing. `files` are update files by name."""

    def __init__(self, folder: pathlib.Path, here: str, former: bool = True,
                 block: dict[str, str] | None = None) -> None:
        self.folder, self.here, self.other = folder, here, "B" if here == "A" else "A"
        self.roots = {what: make_root(folder, what, seed)
                      for seed, what in enumerate((RUNNING, NEW, FORMER))}
        first = {here: self.roots[RUNNING], self.other: self.roots[FORMER] if former else b""}
        block = ({"slot": "B"} if here == "B" else {}) if block is None else block
        image = folder / "disk.img"
        self.block_at = update_cut.make_disk(image, block, first)
        self.before = image.read_bytes()
        self.key = folder / "test.key"
        public = update_file.make_key(self.key, "-W")
        self.place = folder / "machine"
        for name in ("proc", "run", "data", "etc/ddx/update-keys"):
            (self.place / name).mkdir(parents=True)
        (self.place / "etc/ddx/update-keys/test.pub").write_text(public.read_text())
        (self.place / "etc/ddx/trial").write_text("step=0.1\nssh=1\n")
        self.words(f"ddx.slot={here} ddx.layout=1 ddx.counted=begun=1")
        self.release()
        self.device = LoggedDevice(image)
        self.devices = [self.device.part(*BOOT), *(self.device.part(*SLOTS[name]) for name in "AB")]
        run(["mount", "-o", "noatime,commit=1000", self.device.part(*DATA), self.place / "data"])

    def words(self, text: str) -> None:
        (self.place / "proc/cmdline").write_text(f"root=x {text}\n")

    def release(self, what: Release = RUNNING, oldest: str = "0") -> None:
        (self.place / "etc/os-release").write_text(
            f'VARIANT_ID={what.board}\nVERSION="{what.version}"\nDDX_LAYOUT={what.layout}\n'
            f"DDX_SERIAL={what.serial}\nDDX_OLDEST={oldest}\n")

    def update(self, what: Release = NEW) -> bytes:
        """A good update file."""
        return update_file.make(what, self.roots[NEW], self.key)

    def run(self, command: str, *options: str, stdin: bytes | Iterator[bytes] = b"", env: dict[str, str] | None = None,
            pipe: bool = False) -> subprocess.CompletedProcess[str]:
        """Run ddxupdate; its input is a file, or a pipe, as it is for pieces that come one after the other."""
        devices = self.devices[:1] if command in ("block", "keep", "seen", "ended", "trial") else self.devices
        program = native.build() / "usr/libexec/ddx/ddxupdate"
        words = [str(program), "-root", str(self.place), command, *options, *devices]
        environment = {**os.environ, "DDX_DIR": str(self.place / "run/ddx"),
                       "LD_LIBRARY_PATH": str(library_folder()), **(env or {})}
        if pipe or not isinstance(stdin, bytes):
            with subprocess.Popen(words, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                  stderr=subprocess.PIPE) as process:
                assert process.stdin
                with contextlib.suppress(BrokenPipeError):
                    for piece in [stdin] if isinstance(stdin, bytes) else stdin:
                        process.stdin.write(piece)
                said, errors = process.communicate()
                done = subprocess.CompletedProcess(words, process.returncode, said, errors)
        else:
            file = self.folder / "input"
            file.write_bytes(stdin)
            with file.open("rb") as source:
                done = subprocess.run(words, env=environment, capture_output=True, check=False, stdin=source)
        return subprocess.CompletedProcess(words, done.returncode, done.stdout.decode(), done.stderr.decode())

    def content(self) -> bytes:
        """All of the disk before /data."""
        with self.device.file.open("rb") as file:
            return file.read(DATA[0])

    def slot(self, name: str) -> bytes:
        begin, size = SLOTS[name]
        return self.content()[begin:begin + size]

    def block(self) -> dict[str, str] | None:
        return boot_block.block_of(self.content()[self.block_at:self.block_at + boot_block.BYTES])

    def set_block(self, block: dict[str, str]) -> None:
        """As the boot loader does."""
        with open(self.devices[0], "r+b") as file:
            file.seek(self.block_at - BOOT[0])
            file.write(boot_block.text_of(block))
            file.flush()
            os.fsync(file.fileno())

    def stop(self) -> None:
        """Let go of the disk: its log is complete then."""
        if self.device.loops:
            run(["umount", self.place / "data"])
            self.device.end()

    def end(self) -> None:
        self.stop()
