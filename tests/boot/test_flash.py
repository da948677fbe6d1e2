# SPDX-License-Identifier: GPL-2.0-or-later
"""A disk that was full of old data, flashed, boots and serves; another one in the same machine is left alone."""
import os
import pathlib
import subprocess
import sys
import time

from parts.common import PATIENCE, SBIN, TOP, run
from parts.guest.machine import Machine
from parts.guest.qemu import Guest

NOISE = 2**20
ROOM = 64  # MiB more than the image needs, as a real card has


def loop_device(file: pathlib.Path) -> str:
    """A disk made of the file; empty where there are no loop devices or no rights to them."""
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


def test_a_flashed_disk_boots_and_serves(image: pathlib.Path, accel: str, board: Machine,
                                         tmp_path: pathlib.Path) -> None:
    disk, strange = tmp_path / "disk.img", tmp_path / "strange.qcow2"
    flash(image, disk)
    # As it comes from the image: with the same labels, and a ddx.txt that opens no console. Its name, sda, comes before
    # that of the disk that is booted, vda.
    run(["qemu-img", "create", "-q", "-f", "qcow2", "-F", "raw", "-b", image.resolve(), strange])
    extra = ("-drive", f"if=none,id=other,file={strange},format=qcow2", "-device", "qemu-xhci",
             "-device", "usb-storage,drive=other")
    try:
        # Nothing but what was flashed tells it anything.
        with Guest(disk, accel, board, console=False, extra=extra) as guest:
            assert guest.sh("hostname") == "flashed"
            guest.wait_until('[ "$(blkid | grep -c DDXDATA)" = 2 ]')
            for folder in ["/data", "/rec"]:
                assert guest.sh(f"grep ' {folder} ' /proc/mounts").startswith("/dev/vda")
                guest.sh(f"touch {folder}/file")
            deadline = time.monotonic() + PATIENCE
            for program in ["store", "ddxvideosave"]:
                while guest.shell().run(f"/etc/init.d/S*{program} status")[0] != 0:
                    assert time.monotonic() < deadline, program
                    time.sleep(0.2)
            assert "EXT4-fs error" not in guest.sh("dmesg")
            assert not [line for line in guest.sh("cat /run/log/boot").splitlines() if line.split()[2] != "0"]
    finally:
        disk.unlink()
