# SPDX-License-Identifier: GPL-2.0-or-later
"""The serial line belongs to the robot: bytes that a device sends there from power-on are not commands."""
import time

import pytest

from parts.guest.qemu import USERSPACE, Guest

from .noise import PAUSE, SENTENCE, Noise

pytestmark = pytest.mark.retry


def test_the_machine_boots_while_a_device_sends(closed: Guest, noise: Noise) -> None:
    """A byte could stop GRUB's countdown forever, Ctrl-S our output, Ctrl-C a program."""
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
    """A device at another speed sends breaks: to the kernel's console that would be SysRq, and `b` a reset."""
    guest.sh("exec 9< /dev/ttyS0")
    line = guest.channel("ttyS0")
    guest.monitor("chardev-send-break", id="ttyS0")
    line.send("bx")
    assert guest.sh("dd bs=1 count=2 <&9 2> /dev/null; exec 9<&-").endswith("bx")
    line.close()
