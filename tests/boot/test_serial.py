# SPDX-License-Identifier: GPL-2.0-or-later
"""The serial line belongs to the robot: bytes of a device there, from power-on, are no commands."""
import time

from parts.guest.qemu import USERSPACE, Guest

from .noise import PAUSE, SENTENCE, Noise


def test_the_machine_comes_up_beside_a_device_that_speaks(closed: Guest, noise: Noise) -> None:
    """Bytes in GRUB's countdown would stop it for ever, a Ctrl-S our own output, a Ctrl-C what runs."""
    closed.wait_for_log(USERSPACE)
    assert noise.before > 5 or not noise.from_power_on
    closed.wait_for_log(b"Starting ddxhealth: OK")
    closed.wait_for_log(b"this console is closed")
    before = noise.sent
    while noise.sent < before + 5:
        time.sleep(PAUSE)
    said = closed.log.read_bytes()
    assert said.count(USERSPACE) == said.count(b"this console is closed") == 1
    assert SENTENCE[:20] not in said  # no echo


def test_a_break_and_a_letter_do_not_reset_the_machine(guest: Guest) -> None:
    """As a device at another speed looks: for the kernel's console that was SysRq, and `b` the reset."""
    guest.sh("exec 9< /dev/ttyS0")
    line = guest.channel("ttyS0")
    guest.monitor("chardev-send-break", id="ttyS0")
    line.send("bx")
    assert guest.sh("dd bs=1 count=2 <&9 2> /dev/null; exec 9<&-").endswith("bx")
    line.close()
