# SPDX-License-Identifier: GPL-2.0-or-later
"""The image's root file system with some files changed, for the other slot."""
import pathlib
import re
import shutil
from collections.abc import Callable

import pytest

import build
from parts.common import PATIENCE, run, scratch, wait_until
from parts.guest.qemu import Guest
from parts.image import rootfs
from parts.release import update_file

VERSION = "9.9.9 (new)"
# A trial of seconds: an emulated machine boots slowly, but nothing is judged by its speed.
RULES = "good=15\ndeadline=120\nwatchdog=90\n"
# QEMU's hardware watchdog; the machine does start again.
DOG = ("-device", "i6300esb", "-action", "reboot=reset,watchdog=reset")
# A trial to its deadline records more than the disk takes.
SETTINGS = {"ddxvideoload.conf": "loop=\nreaders=1\n", "ddxvideosave.conf": "segment=8\nfull=recycle\n"}
RECORDS = "ddxctl stats --json | grep -q '\"instance\":\"ddxvideosave\",\"in\":[1-9]'"
Change = Callable[[pathlib.Path], object]


def make(root: pathlib.Path, image: pathlib.Path, change: Change = lambda folder: None,
         version: str = VERSION) -> pathlib.Path:
    """A squashfs of the unpacked `root` with another version, a short trial, and one change more."""
    with scratch() as folder:
        copy = folder / "root"
        run(["cp", "-a", root, copy])
        release = copy / "usr/lib/os-release"
        text = re.sub("^VERSION=.*$", f'VERSION="{version}"', release.read_text(), flags=re.MULTILINE)
        release.write_text(re.sub("^PRETTY_NAME=.*$", f'PRETTY_NAME="DDXVIDEO {version}"', text, flags=re.MULTILINE))
        (copy / "etc/ddx/trial").write_text(RULES)
        change(copy)
        shutil.copy(build.DEV / "boot-files.actions", folder)  # the list is the same for all boards
        rootfs.pack(copy, image)
    return image


def skip_unless_updates(root: pathlib.Path) -> None:
    """The image has to accept updates that the tests sign."""
    public = build.UPDATE_KEY.with_name(f"{build.UPDATE_KEY.name}.pub")
    trusted = [path.read_bytes() for path in (root / "etc/ddx/update-keys").glob("*")]
    if not public.exists() or public.read_bytes() not in trusted:
        pytest.skip(f"the image does not accept updates of {public}; build it with UPDATE_KEYS={public}")


def sign(squashfs: pathlib.Path, file: pathlib.Path) -> pathlib.Path:
    """An update file with this root file system."""
    file.write_bytes(update_file.make(update_file.release(squashfs), squashfs.read_bytes(), build.UPDATE_KEY))
    return file


def update(root: pathlib.Path, folder: pathlib.Path) -> tuple[pathlib.Path, pathlib.Path]:
    """A new root file system, and the update file with it."""
    skip_unless_updates(root)
    new = make(root, folder / "new.squashfs")
    return new, sign(new, folder / "new.update")


def script(path: pathlib.Path, text: str) -> None:
    """Put a script in the place of a program."""
    path.unlink()
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)


def remove(folder: pathlib.Path, pattern: str) -> None:
    """Remove what a pattern names, which must be there."""
    found = list(folder.rglob(pattern))
    assert found, pattern
    for path in found:
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink()


def wait_for_boots(guest: Guest, count: int, patience: float = PATIENCE) -> None:
    """Wait until the boot loader has begun for the `count`th time: QEMU can report one restart as two RESET events."""
    wait_until(lambda: guest.log.read_bytes().count(b"GNU GRUB") >= count, f"no boot {count}", 1, patience)
    guest.reset()
