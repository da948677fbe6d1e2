# SPDX-License-Identifier: GPL-2.0-or-later
"""The commands in docs/technician.md work as printed: make docs, without its pictures."""
import pathlib

import pytest

import docs
from parts.guest.qemu import Boot

pytestmark = [pytest.mark.retry, pytest.mark.long]


def test_each_command_of_the_technicians_page(boot: Boot, image: pathlib.Path, work: pathlib.Path) -> None:
    commands = docs.commands()
    assert {machine for machine, _ in commands} == {docs.ROBOT, docs.LAPTOP}
    assert len(commands) > 10 and commands[-1] == (docs.ROBOT, "poweroff")
    users = docs.laptops(work / "docs")
    with boot("docs", **docs.provide(image, work / "docs", users)) as guest:
        docs.prepare(guest)
        assert not docs.check(guest, users, docs.ROBOT, "ddxctl enable ddxvideo")  # proves that the check can fail
        assert not docs.check(guest, users, docs.LAPTOP, "scp root@robot1:/nothing .")
        assert [line for line in commands if not docs.check(guest, users, *line)] == []
