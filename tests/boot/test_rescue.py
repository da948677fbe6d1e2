# SPDX-License-Identifier: GPL-2.0-or-later
"""The menu's rescue entry, chosen over the serial line: a shell, and neither services nor their file systems."""

from parts.guest.channel import Timeout
from parts.guest.qemu import USERSPACE, Boot, Guest

OWN = "/usr/libexec/ddx/own-partition"
DOWN = "\x1b[B"
KEYS = 20
CHOSEN = rb"\x1b\[7m\x1b\[\d+;3H\*[^\x1b]*"  # the entry that GRUB shows in reverse


def choose(guest: Guest) -> None:
    menu = guest.channel("ttyS0")
    try:
        menu.wait(b"Rescue", 60)
        # One key after the other, when the menu has answered: GRUB loses a key that comes while it draws, on a screen
        # with UEFI for seconds. Without an answer the key is sent again. At its last entry the menu stays where it is.
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


def test_rescue_touches_nothing(boot: Boot) -> None:
    with boot("rescue", serial=True, environment=("left=3",)) as guest:
        choose(guest)
        guest.shell()
        words = guest.sh("cat /proc/cmdline").split()
        assert "ddx.rescue" in words and "ddx.slot=A" in words
        for folder in ["/data", "/rec"]:
            assert guest.shell().run(f"mountpoint -q {folder}")[0] != 0, folder
        assert guest.shell().run("pidof store ddxvideosave ddxvideoload resize2fs")[0] != 0
        assert guest.sh("ls /run/service") == ""
        # GRUB has counted a boot of a slot on trial, and it proves nothing
        assert guest.environment() == {"left": "2"}
        # what it is for: the file systems can be looked after, by hand
        guest.sh(f"e2fsck -fn $({OWN} 6) && e2fsck -fy $({OWN} 5)")
        guest.sh(f"mount -t ext4 -o ro $({OWN} 6) /rec && umount /rec")
        guest.reset()
        assert guest.shell("ttyS0").run("echo heard") == (0, "heard\n")
