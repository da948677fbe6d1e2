# SPDX-License-Identifier: GPL-2.0-or-later
"""The shipped scripts that mount settings and recordings, with replaced programs and /run: when `mount` fails, they try
again, and finally report it."""
from __future__ import annotations

import os
import pathlib
import subprocess

import pytest

from parts.common import TOP

from .programs import wait_until

pytestmark = pytest.mark.retry

DISKS = {"DDXDATA": "/data", "DDXREC": "/rec", "DDXTEST": "/test"}
# Refuses the first mounts of a folder, `refuse.<folder>` times; then records it as mounted.
MOUNT = """#!/bin/sh
for folder; do :; done
name=${folder#/}
if read -r left < refuse.$name && [ "$left" -gt 0 ]; then
	echo $((left - 1)) > refuse.$name
	echo "mount: mounting on $folder failed: No such device" >&2
	exit 255
fi
echo "$folder" >> mounted
"""
FAKES = {
    "mount": MOUNT,
    "mountpoint": '#!/bin/sh\ngrep -qx "$2" mounted\n',
    "blkid": "#!/bin/sh\n" + "".join(f"echo '/dev/{label}: LABEL=\"{label}\"'\n" for label in DISKS),
    "own-partition": '#!/bin/sh\ncase $1 in 5) echo /dev/DDXDATA ;; 6) echo /dev/DDXREC ;; esac\n',
    "umount": "#!/bin/sh\nsed -i \"\\|^$1$|d\" mounted\n",
    "settings-copy": "#!/bin/sh\nexit 1\n",
    "grow": "#!/bin/sh\n",
    "serial": "#!/bin/sh\nexec cat\n",
    "modprobe": '#!/bin/sh\necho "$*" >> modprobe.said\n',
    **{name: "#!/bin/sh\n" for name in ("e2fsck", "chown", "chmod", "mkdir", "sleep")}}


class Machine:
    def __init__(self, folder: pathlib.Path) -> None:
        self.folder = folder
        (folder / "log").mkdir()
        (folder / "programs").mkdir()
        (folder / "cmdline").write_text("quiet\n")
        (folder / "mounted").touch()
        (folder / "provision").write_text("hostname=robot\ntest=yes\n")
        for name, text in FAKES.items():
            (folder / "programs" / name).write_text(text)
            (folder / "programs" / name).chmod(0o755)
        for name in ("own-partition", "settings-copy", "serial", "grow"):
            (folder / name).symlink_to(f"programs/{name}")
        for name in ("storage", "recordings-disk", "init-action", "S15storage"):
            place = "etc/init.d" if name.startswith("S") else "usr/libexec/ddx"
            text = (TOP / "overlay" / place / name).read_text()
            for theirs in ("/usr/libexec/ddx/", "/proc/", "/run/", "/dev/console"):
                text = text.replace(theirs, f"{folder}/{theirs[1:] if theirs.startswith('/dev') else ''}")
            (folder / name).write_text(text)
            (folder / name).chmod(0o755)
        for name in ("dev", "disks"):
            (folder / name).mkdir()

    def refuse(self, where: str, times: int) -> None:
        (self.folder / f"refuse.{where}").write_text(f"{times}\n")

    def start(self) -> tuple[int, str]:
        path = f"{self.folder}/programs:{os.environ['PATH']}"
        done = subprocess.run(["sh", self.folder / "S15storage", "start"], cwd=self.folder, text=True, check=False,
                              env={"PATH": path}, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, timeout=300)
        return done.returncode, done.stdout

    def recordings(self) -> str:
        """The result of the background job that mounts them."""
        said = self.folder / "log/recordings-disk"
        wait_until(lambda: said.exists() and said.read_text() != "" and
               not said.read_text().endswith("is being checked\n"))
        return said.read_text().splitlines()[-1]

    @property
    def mounted(self) -> set[str]:
        return set((self.folder / "mounted").read_text().split())

    def log(self, label: str) -> str:
        return (self.folder / "log" / f"check.{label}").read_text()


@pytest.fixture
def machine(tmp_path: pathlib.Path) -> Machine:
    return Machine(tmp_path)


def test_all_is_mounted_and_drivers_are_loaded_first(machine: Machine) -> None:
    assert machine.start() == (0, "Starting storage: OK\n")
    assert machine.recordings() == "/dev/DDXREC is there"
    assert machine.mounted == set(DISKS.values())
    assert {"ext4", "crc32c_generic", "vfat"} <= set((machine.folder / "modprobe.said").read_text().split())


def test_a_test_disk_is_not_mounted_unless_requested(machine: Machine) -> None:
    (machine.folder / "provision").write_text("hostname=robot\ntest=no\n")
    assert machine.start() == (0, "Starting storage: OK\n")
    assert machine.recordings() == "/dev/DDXREC is there"
    assert machine.mounted == {"/data", "/rec"}


@pytest.mark.parametrize("label", DISKS)
def test_a_mount_that_fails_once_is_tried_again(machine: Machine, label: str) -> None:
    machine.refuse(DISKS[label][1:], 1)
    assert machine.start() == (0, "Starting storage: OK\n")
    assert machine.recordings() == "/dev/DDXREC is there"
    assert machine.mounted == set(DISKS.values())
    assert "No such device" in machine.log(label)


@pytest.mark.parametrize("label", DISKS)
def test_a_mount_that_always_fails_is_reported_and_others_work(machine: Machine, label: str) -> None:
    folder = DISKS[label]
    machine.refuse(folder[1:], 1000)
    if label == "DDXREC":
        assert machine.start() == (0, "Starting storage: OK\n")  # the boot did not wait for it
        assert "cannot be used" in machine.recordings()
    else:
        assert machine.start() == (1, f"Starting storage: FAIL: {folder[1:]}\n")
        assert machine.recordings() == "/dev/DDXREC is there"
    assert machine.mounted - {"/data"} == set(DISKS.values()) - {folder} - {"/data"}
    assert label != "DDXDATA" or "settings are the image's" in (machine.folder / "settings.lost").read_text()
    assert "No such device" in machine.log(label)
    assert int((machine.folder / f"refuse.{folder[1:]}").read_text()) > 900  # it gives up soon
