# SPDX-License-Identifier: GPL-2.0-or-later
"""A disk full of old data boots after it was flashed; other disks in the machine are not touched."""
import os
import pathlib
import subprocess
import sys
from collections.abc import Iterator

import pytest

from parts.common import SBIN, TOP, run
from parts.guest.machine import Machine
from parts.guest.qemu import Guest

pytestmark = pytest.mark.retry

NOISE = 2**20
ROOM = 64  # MiB beyond the image's size, as on a real card


def loop_device(file: pathlib.Path) -> str:
    """A loop device of the file; empty without loop devices or rights to them."""
    done = subprocess.run(["losetup", "--find", "--show", file], env={**os.environ, **SBIN}, capture_output=True,
                          text=True, check=False)
    return done.stdout.strip() if done.returncode == 0 else ""


def flash(image: pathlib.Path, disk: pathlib.Path) -> None:
    noise = os.urandom(NOISE)
    with disk.open("wb") as file:
        for _ in range(image.stat().st_size // NOISE + ROOM):
            file.write(noise)
    device = loop_device(disk)
    words = [f"DEV={device}"] if device else [f"DEV={disk}", "FILE=1"]
    try:
        subprocess.run([sys.executable, "-B", TOP / "tools/flash.py", f"IMAGE={image}", *words, "YES=1",
                        "HOSTNAME=flashed", "CONSOLE=open"], check=True)
    finally:
        if device:
            subprocess.run(["losetup", "--detach", device], env={**os.environ, **SBIN}, check=True)


@pytest.fixture(scope="module")
def flashed(image: pathlib.Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[pathlib.Path]:
    disk = tmp_path_factory.mktemp("flashed") / "disk.img"
    flash(image, disk)
    yield disk
    disk.unlink()


def test_a_flashed_disk_boots_and_serves(image: pathlib.Path, flashed: pathlib.Path, accel: str, board: Machine,
                                         tmp_path: pathlib.Path) -> None:
    """The booted disk is sda. One of the others, nvme0n1, sorts before it, and one, vda, after it."""
    # The others: the image itself, with the same labels, and a ddx.txt that opens no console.
    extra: tuple[str, ...] = ("-global", "usb-storage.bootindex=0")
    for other, device in [("first", "nvme,serial=other"), ("last", "virtio-blk-pci")]:
        strange = tmp_path / f"{other}.qcow2"
        run(["qemu-img", "create", "-q", "-f", "qcow2", "-F", "raw", "-b", image.resolve(), strange])
        extra += ("-drive", f"if=none,id={other},file={strange},format=qcow2", "-device", f"{device},drive={other}")
    # The machine gets no settings but those that were flashed.
    with Guest(flashed, accel, board, console=False, extra=extra, bus="usb", processors=1) as guest:
        assert guest.sh("hostname") == "flashed"
        guest.wait_until('[ "$(blkid | grep -c DDXDATA)" = 3 ]')
        for disk in ("nvme0n1", "sda", "vda"):
            guest.sh(f"test -b /dev/{disk}")
        for folder in ["/data", "/rec"]:
            assert guest.sh(f"grep ' {folder} ' /proc/mounts").startswith("/dev/sda")
            guest.sh(f"touch {folder}/file")
        for program in ["ddxstore", "ddxvideosave"]:
            guest.wait_until(f"/etc/init.d/S*{program} status")
        assert "EXT4-fs error" not in guest.sh("dmesg")
        assert not [line for line in guest.sh("cat /run/log/boot").splitlines() if line.split()[2] != "0"]
