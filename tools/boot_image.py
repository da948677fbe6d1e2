#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""make boot: the image in QEMU, to look around, until it is switched off. boot_image.py [BOARD]

The console is in this terminal, and SSH and the screen (VNC) are at ports of this machine that are printed. A drawn
clip takes a camera's place, again and again. Nothing is kept: the next boot begins with the image as it was built. A
key for SSH is made in output/boot. Exit status 0 after `poweroff` and after Ctrl-].
"""
import pathlib
import sys

import build
from parts.common import OUTPUT, TOP, Failed, finish, run, say
from parts.guest import laptop, machine, qemu, terminal, testdisk
from parts.media import clip

WORK = OUTPUT / "boot"
GROWS = 1 << 30  # bytes that the disk is larger than the image, for recordings
VNC = 5900       # the port of display 0


def login_key() -> pathlib.Path:
    """A key for this guest alone; its public half has the same name with .pub."""
    key = WORK / "key"
    if not key.exists():
        run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-C", "make boot", "-f", key])
    return key


def display() -> int:
    """A display number for VNC whose port is free."""
    for number in range(100):
        if laptop.is_free(VNC + number):
            return number
    raise Failed(f"no port is free for the screen, from {VNC} to {VNC + 99}")


def main() -> int:
    board = sys.argv[1] if len(sys.argv) > 1 and sys.argv[1] else machine.DEV
    chosen = machine.machines(board)[0]
    image, development = build.images(board)
    WORK.mkdir(parents=True, exist_ok=True)
    disk = testdisk.make(WORK / "test.img", clip.write(WORK / "clip.y4m", clip.SHORT),
                         {"ddxvideoload.conf": "loop=\nonce=no\n"})
    key, port, number = login_key(), laptop.free_port(), display()
    accel = qemu.acceleration(development)
    with qemu.Guest(image, accel, chosen, serial=True, screen=True, test_disk=disk, log=WORK / "console.log",
                    size=image.stat().st_size + GROWS,
                    provision=f"hostname=robot1\nnetwork=eth0 dhcp\nssh_key={key.with_suffix('.pub').read_text()}",
                    extra=(*laptop.forward(port), "-vnc", f"127.0.0.1:{number}")) as guest:
        say(f"boot: {image.relative_to(TOP)} ({chosen.firmware}, {accel})")
        say(f"boot: ssh -i {key.relative_to(TOP)} -o StrictHostKeyChecking=no -o UserKnownHostsFile=/dev/null "
            f"-p {port} root@127.0.0.1")
        say(f"boot: the screen: a VNC viewer at 127.0.0.1:{VNC + number}")
        say("boot: it runs until `poweroff`; commands to try: docs/technician.md")
        console = guest.channel("ttyS0")
        if sys.stdin.isatty() and sys.stdout.isatty():
            terminal.attach(console)
        else:
            guest.process.wait()
    return 0


if __name__ == "__main__":
    finish("boot", main)
