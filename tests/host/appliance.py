# SPDX-License-Identifier: GPL-2.0-or-later
"""Runs the image's scripts on the desk, under its BusyBox, in their own root folder and process namespace."""
from __future__ import annotations

import contextlib
import os
import pathlib
import shutil
import subprocess
from collections.abc import Iterator

import pytest

from parts.common import MORTAL
from parts.image import busybox, rootfs

from .programs import ROOT, TOP, library_folder

USERS = {"root": 0, "ddxhealth": 901, "ddxlog": 902}
GROUPS = {"root": 0, "ddx": 900}
SERVICE = ("finish", "folder", "merge.awk", "service", "settings.awk")
SETUP = 'mount --bind "$0" "$0" && cd / && mount --rbind /dev "$0/dev" && mount -t proc proc "$0/proc" && ' \
        'exec chroot "$0" sh -c "echo ready && exec cat"'


class Appliance:
    """A root folder; its programs are killed with the holder process. Skips the test without root."""

    def __init__(self, folder: pathlib.Path) -> None:
        if os.geteuid() != 0:
            pytest.skip("a separate root folder needs root")
        self.root = folder / "root"
        shutil.copytree(busybox.busybox(), self.root, symlinks=True)
        for name in ("dev", "proc", "etc/default", "run/service", "run/log", "usr/libexec/ddx"):
            (self.root / name).mkdir(parents=True)
        (self.root / "etc/passwd").write_text("".join(f"{name}:x:{id}:0::/:/bin/sh\n" for name, id in USERS.items()))
        (self.root / "etc/group").write_text("".join(f"{name}:x:{id}:\n" for name, id in GROUPS.items()))
        self.holder = subprocess.Popen([*MORTAL, "unshare", "--mount", "--pid", "--fork", "--kill-child", "sh", "-c",
                                        SETUP, self.root], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert self.holder.stdout and self.holder.stdout.readline() == "ready\n"
        inside = pathlib.Path(f"/proc/{self.holder.pid}/task/{self.holder.pid}/children").read_text().strip()
        self.enter = ["nsenter", "--mount", "--pid", "--root", "--wd=/", "--target", inside, "env", "-i",
                      "PATH=/usr/sbin:/usr/bin:/sbin:/bin", "sh", "-c"]

    def install(self, script: str, to: str) -> None:
        """Copy a script of the source tree."""
        self.add(to, (TOP / script).read_text())

    def install_service(self) -> None:
        """Copy the scripts that start services."""
        for script in SERVICE:
            self.install(f"package/ddxservice/{script}", f"usr/libexec/ddx/{script}")
        self.install("overlay/usr/libexec/ddx/init-action", "usr/libexec/ddx/init-action")
        shutil.copy(ROOT / "libexec/ddx/launch", self.root / "usr/libexec/ddx/launch")

    def add(self, to: str, text: str) -> None:
        path = self.root / to
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        path.chmod(0o755)

    def install_program(self, program: pathlib.Path, to: str) -> None:
        """Copy a program of the desk build, and the libraries that it needs."""
        ours = library_folder()
        found = rootfs.libraries(program, [ours])
        libraries = [(path, f"usr/lib/{path.name}" if path.is_relative_to(ours) else str(path)[1:]) for path in found]
        for file, name in [(program, to), *libraries]:
            (self.root / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(file, self.root / name)

    def start(self, command: str) -> subprocess.Popen[str]:
        return subprocess.Popen([*self.enter, command], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)

    def run(self, command: str) -> tuple[int, str]:
        done = self.start(command)
        text, _ = done.communicate(timeout=60)
        return done.returncode, text

    def end(self) -> None:
        self.holder.communicate()


@contextlib.contextmanager
def with_service(folder: pathlib.Path) -> Iterator[Appliance]:
    """A root folder with the scripts of services."""
    appliance = Appliance(folder)
    appliance.install_service()
    yield appliance
    appliance.end()
