# SPDX-License-Identifier: GPL-2.0-or-later
"""The kernel's last messages are available after a reset."""
import pathlib

import pytest

from parts.guest.qemu import Boot, Guest

from .test_control import run

pytestmark = [pytest.mark.retry, pytest.mark.long]

RESET = ("-action", "reboot=reset")
WORDS = "the last words of this machine"
MEMORY = 1600  # MiB more, so that the next kernel, loaded anywhere, overwrites them only one time in fifty
ATTEMPTS = 3
FETCHED = "[ -e /run/late.done ]"


def last_words(guest: Guest, command: str) -> str:
    """The messages kept of a boot that ends with this command, or, if empty, with a reset from outside."""
    for _ in range(ATTEMPTS):
        guest.shell()
        if command:
            guest.shell().begin(command)
            guest.wait_for_event("RESET")
        else:
            guest.sh(f"echo '<3>{WORDS}' > /dev/kmsg; sleep 1")
            guest.monitor("system_reset")
        guest.reset()
        guest.wait_until(FETCHED)
        if said := guest.sh("ddxctl logs lastboot"):
            return said
    return ""


def test_a_kernel_panic_is_reported_after_the_reset(boot: Boot) -> None:
    with boot("lastboot-panic", extra=RESET, more_memory=MEMORY) as guest:
        guest.wait_until(FETCHED)
        assert "! last boot" not in run(guest, "ddxctl health")[1]
        assert guest.sh("ddxctl logs lastboot") == ""
        assert "sysrq_handle_crash" in last_words(guest, "echo c > /proc/sysrq-trigger")
        screen = run(guest, "ddxctl health")[1]
        assert "! last boot  the kernel: Kernel panic - not syncing: sysrq triggered crash; ddxctl logs" in screen


def test_the_console_s_text_survives_a_sudden_reset(boot: Boot, image: pathlib.Path) -> None:
    """Like the watchdog's reset: the kernel cannot write a last message."""
    if "CONFIG_PSTORE_CONSOLE=y" not in (image.parent / "kernel/boot/config").read_text():
        pytest.skip("Debian's kernel, in the development image, has no PSTORE_CONSOLE; the product's has")
    with boot("lastboot-reset", extra=RESET, more_memory=MEMORY) as guest:
        assert WORDS in last_words(guest, "")
