# SPDX-License-Identifier: GPL-2.0-or-later
"""The menu's rescue entry, chosen over the serial line: a shell, and neither services nor their file systems."""
import time

from qemu import USERSPACE, Boot

DOWN = "\x1b[B"


def test_rescue_touches_nothing(boot: Boot) -> None:
    with boot("rescue") as guest:
        menu = guest.channel("ttyS0")
        menu.wait(b"Rescue", 60)
        for key in [DOWN, DOWN, "\r"]:
            menu.send(key)
            time.sleep(0.2)  # as fast as fingers; faster, and the serial line may lose a key
        menu.wait(USERSPACE, 60)
        menu.close()  # who is connected and does not read stops the guest
        guest.shell()
        words = guest.sh("cat /proc/cmdline").split()
        assert "ddx.rescue" in words and "ddx.slot=A" in words
        for folder in ["/data", "/rec"]:
            assert guest.shell().run(f"mountpoint -q {folder}")[0] != 0, folder
        assert guest.shell().run("pidof store ddxvideosave ddxvideoload resize2fs")[0] != 0
        assert guest.sh("ls /run/service") == ""
        # what it is for: the file systems can be looked after, by hand
        guest.sh("e2fsck -fn $(findfs LABEL=DDXREC) && e2fsck -fy $(findfs LABEL=DDXDATA)", 60)
        guest.sh("mount -t ext4 -o ro LABEL=DDXREC /rec && umount /rec")
