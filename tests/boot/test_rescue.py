# SPDX-License-Identifier: GPL-2.0-or-later
"""The boot menu's rescue entry, chosen over the serial line: a shell without services and their file systems."""

import pytest

from parts.disk.disk import Disk
from parts.guest.channel import Timeout
from parts.guest.qemu import USERSPACE, Boot, Guest

from .test_slots import fill_slot_b, spoil

pytestmark = pytest.mark.retry

OWN = "/usr/libexec/ddx/own-partition"
DOWN = "\x1b[B"
KEYS = 20
CHOSEN = rb"\x1b\[7m\x1b\[\d+;3H\*[^\x1b]*"  # the entry that GRUB shows in reverse


def choose(guest: Guest) -> None:
    menu = guest.channel("ttyS0")
    try:
        menu.wait(b"Rescue", 60)
        # Each key waits for the menu's answer to the one before, since GRUB loses keys while it draws (seconds with
        # UEFI). A key without an answer is sent again, which is harmless at the menu's last entry.
        chosen = b""
        for _ in range(KEYS):
            menu.send(DOWN)
            try:
                chosen = menu.wait(CHOSEN, 5)[0]
            except Timeout:
                continue
            if b"Rescue" in chosen:
                break
        else:
            raise Timeout(f"the menu's entry is {chosen!r} after {KEYS} keys")
        menu.send("\r")
        menu.wait(USERSPACE, 60)
    except Timeout:
        if not guest.boots_again():
            raise
        choose(guest)
        return
    menu.close()  # a connected client that does not read stops the guest


def spoilt_a(disk: Disk) -> None:
    fill_slot_b(disk)
    spoil(disk, "A")


def test_rescue_starts_no_service_and_mounts_nothing(boot: Boot) -> None:
    """In slot B, since the chosen one cannot be read."""
    with boot("rescue", serial=True, environment=("left=3",), prepare=spoilt_a, processors=1) as guest:
        choose(guest)
        guest.shell()
        words = guest.sh("cat /proc/cmdline").split()
        assert "ddx.rescue" in words and "ddx.slot=B" in words
        for folder in ["/data", "/rec"]:
            assert guest.shell().run(f"mountpoint -q {folder}")[0] != 0, folder
        assert guest.shell().run("pidof ddxstore ddxvideosave ddxvideoload resize2fs")[0] != 0
        assert guest.sh("ls /run/service") == ""
        # GRUB counts the boot, but the rescue shell does not accept the slot
        assert guest.environment() == {"left": "2"}
        # the file systems can be repaired by hand
        guest.sh(f"e2fsck -fn $({OWN} 6) && e2fsck -fy $({OWN} 5)")
        guest.sh(f"mount -t ext4 -o ro $({OWN} 6) /rec && umount /rec")
        guest.reset()
        assert guest.shell("ttyS0").run("echo heard") == (0, "heard\n")
