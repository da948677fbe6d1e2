# SPDX-License-Identifier: GPL-2.0-or-later
"""Owners of devices: the image's mdev with its settings, and devices that no emulated machine has."""
from __future__ import annotations

import pathlib
import shutil

import pytest

import build
from parts.common import OUTPUT
from parts.image import native

from .appliance import Appliance

pytestmark = pytest.mark.retry

# Name in /dev, number, expected owner, group and mode.
DEVICES = [
    ("video0", "81:0", "ddxgrab video 660"), ("media0", "249:0", "ddxgrab video 660"),
    ("fw0", "248:0", "ddx1394 video 660"), ("bus/usb/001/002", "189:1", "ddx1394 video 660"),
    ("dri/card0", "226:0", "ddxplay video 660"), ("dri/renderD128", "226:128", "root video 660"),
    ("ttyS0", "4:64", "root dialout 660"), ("ttyUSB12", "188:12", "root dialout 660"),
    ("ttyACM0", "166:0", "root dialout 660"), ("watchdog0", "247:0", "ddxhealth ddx 660"),
    ("null", "1:3", "root root 666"), ("mem", "1:1", "root root 660"), ("ttyprintk", "5:3", "root root 660"),
]


def test_each_kind_of_device_has_its_owner(tmp_path: pathlib.Path) -> None:
    appliance = Appliance(tmp_path)
    build.dev([native.build()])
    for name in ("passwd", "group", "mdev.conf"):
        shutil.copy(OUTPUT / "dev/root/etc" / name, appliance.root / "etc" / name)
    for name, number, _ in DEVICES:
        folder = appliance.root / "sys/dev/char" / number
        folder.mkdir(parents=True)
        major, minor = number.split(":")
        (folder / "dev").write_text(f"{number}\n")
        (folder / "uevent").write_text(f"MAJOR={major}\nMINOR={minor}\nDEVNAME={name}\n")
    names = " ".join(name for name, _, _ in DEVICES)
    text = appliance.run(f"mount -t tmpfs none /dev && mdev -s && cd /dev && stat -c '%n %U %G %a' {names}")[1]
    appliance.end()
    assert text.splitlines() == [f"{name} {owner}" for name, _, owner in DEVICES]
