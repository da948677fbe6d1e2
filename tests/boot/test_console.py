# SPDX-License-Identifier: GPL-2.0-or-later
"""There is no login unless the provisioning file opens one."""
import pathlib
import time

import pytest

from parts.guest.qemu import Guest

pytestmark = pytest.mark.retry


def test_no_console_without_provisioning(closed: Guest) -> None:
    """Devices send on the serial line all the time: noise.py."""
    closed.wait_for_log(b"this console is closed")
    closed.channel("hvc0").send("\nroot\n\necho al''ive\n")
    time.sleep(3)
    assert b"alive" not in closed.log.read_bytes()
    assert b"ogin:" not in closed.log.read_bytes()


def test_no_password_and_no_key_in_the_image(root: pathlib.Path) -> None:
    for line in (root / "etc/shadow").read_text().splitlines():
        assert line.split(":")[1] in ("*", "!"), line
    for line in (root / "etc/passwd").read_text().splitlines():
        assert line.split(":")[1] in ("*", "x"), line
    keys = [path for path in root.rglob("*") if path.name in ("authorized_keys", "id_rsa") or "host_key" in path.name]
    assert keys == []


def test_console_opened_by_provisioning(guest: Guest) -> None:
    assert guest.sh("cat /run/provision") == "console=open\ntest=yes"
