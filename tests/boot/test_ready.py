# SPDX-License-Identifier: GPL-2.0-or-later
"""The image's ready folders are those that `service start` would write."""
import pytest

from parts.guest.qemu import Guest
from parts.image import tables

pytestmark = pytest.mark.retry

# A second root without other file systems, so without settings, and with its own /run and no processes.
ROOT = "/tmp/fresh"
SETUP = f"""mkdir -p {ROOT} && mount -o bind / {ROOT} && mount -o bind /dev {ROOT}/dev &&
mount -t tmpfs -o mode=755 run {ROOT}/run && mount -t tmpfs proc {ROOT}/proc && : > {ROOT}/proc/cmdline"""
FRESH = f"rm -rf {ROOT}/run/* && mkdir {ROOT}/run/service {ROOT}/run/log"
LISTING = "cd /run && find service log -exec stat -c '%N %a %U %G %F %s' {} + | sort && " \
          "find service log -type f -exec md5sum {} + | sort"


def test_ready_folders_are_those_that_a_start_writes(guest: Guest) -> None:
    def inside(command: str) -> str:
        return guest.sh(f'chroot {ROOT} sh -c "{command}"')

    guest.sh(SETUP)
    try:
        guest.sh(FRESH)
        assert inside("/etc/init.d/S19ready start") == "Starting ready: OK"
        ready, names = inside(LISTING), guest.sh(f"ls {ROOT}/run/service | cat").split()
        said = guest.sh(f"cat {ROOT}/run/ready").split()
        guest.sh(FRESH)
        scripts = " ".join(f"/etc/init.d/{script}" for script in tables.scripts())
        inside(f"for script in {scripts}; do \\$script start; done")
        assert ready.splitlines() == inside(LISTING).splitlines()
    finally:
        guest.sh(f"umount {ROOT}/proc {ROOT}/run {ROOT}/dev {ROOT}")
    assert {"ddxstore", "ddxvideosave", "ddxvideoV4L", "ddxhealth"} <= set(names)
    assert sorted(word.split("=")[0] for word in said) == sorted(tables.services())
    assert "ddxvideoload=/test/clip.y4m" in said
