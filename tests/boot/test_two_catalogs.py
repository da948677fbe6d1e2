# SPDX-License-Identifier: GPL-2.0-or-later
"""The paper's session on two machines: values written on one are read on the other, by name."""
from __future__ import annotations

import pathlib
import tempfile

import pytest

from parts.guest import qemu
from parts.guest.qemu import Guest

from .camera import value
from .segment import Segment

pytestmark = [pytest.mark.retry, pytest.mark.long]

ITEM = "ddxvideosave.stats"


def begin(guest: Guest, name: str, address: str) -> None:
    guest.shell()
    guest.sh(f"hostname {name}; ip link set eth0 up && ip addr add {address}/24 dev eth0; cd /tmp")
    guest.sh("ip route add default dev eth0")


def test_the_other_machine_s_items(boot: qemu.Boot) -> None:
    """`ddxctl set` writes a struct on one machine, `ddxctl show` reads it on the other."""
    with tempfile.TemporaryDirectory(prefix="ddx-") as folder:
        segment = Segment(pathlib.Path(folder), "1")
        with boot("laptop", extra=segment.card(1)) as laptop, boot("robot", extra=segment.card(0)) as robot:
            begin(laptop, "laptop", "10.0.0.2")
            begin(robot, "carol", "10.0.0.1")
            robot.sh("ddxcatalog > /tmp/linked 2>&1 &")
            laptop.sh(f"printf 'item {ITEM}\\n' > /data/ddx/exports.conf")  # the default rules exclude counters
            laptop.sh("printf 'c=/data/ddx/exports.conf\\n' > /data/ddx/ddxcatalog.conf; ddxctl enable ddxcatalog")
            exchange(robot, laptop, "carol")
            exchange(laptop, robot, "laptop")
            assert (said := robot.sh("cat /tmp/linked")) == "", said
        segment.end()


def exchange(writer: Guest, reader: Guest, name: str) -> None:
    reader.wait_until(f"ddxctl catalog | grep -q '^{name}  *heard'")
    writer.sh("/etc/init.d/S*ddxvideosave stop")  # its item stays, and is free for another writer
    before = value(writer, ITEM)
    for count in (4711, 4712):
        writer.sh(f"ddxctl set {ITEM} in={count}")
        reader.wait_until(f"ddxctl show {name}:{ITEM} --json | grep -q '\"in\":{count},'")
        assert value(reader, f"{name}:{ITEM}") == {**before, "in": count}
