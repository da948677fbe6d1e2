# SPDX-License-Identifier: GPL-2.0-or-later
"""One image boots from a disk on any bus, and mounts settings and recordings from the same disk."""
import pytest

from parts.guest import machine
from parts.guest.qemu import Boot

from .conftest import BOARD

pytestmark = pytest.mark.retry

# Part of the path in /sys/devices of a disk on this bus only.
SEEN_AS = {"virtio": "/virtio", "ide": "/ata", "ahci": "/ata", "usb": "/usb", "nvme": "/nvme/", "sd": "/mmc_host/"}
DRIVER = {"ide": "ata_piix", "ahci": "ahci"}
CARD = 1 << 30  # QEMU's SD cards are powers of two
OTHERS = [bus for bus in machine.meta(BOARD)["disk"].split() if bus != "virtio"]  # all other tests use virtio


@pytest.mark.long
@pytest.mark.parametrize("bus", OTHERS)
def test_boots_and_records_from(boot: Boot, board: machine.Machine, bus: str) -> None:
    if (board.firmware, bus) == ("uefi", "sd"):
        pytest.skip("OVMF has no driver for SD cards; a board's own firmware may have one")
    with boot(f"bus-{bus}", bus=bus, size=CARD) as guest:
        guest.wait_until("mountpoint -q /rec")
        device = guest.sh("sed -n 's,^/dev/\\([^ ]*\\) /rec .*,\\1,p' /proc/mounts")
        disk = guest.sh(f"dirname $(readlink -f /sys/class/block/{device})")
        assert SEEN_AS[bus] in disk
        if bus in DRIVER:
            controller = guest.sh(f"cd {disk}; until [ -e class ]; do cd -P ..; done; readlink driver")
            assert controller.endswith(f"/{DRIVER[bus]}")
        name = disk.rpartition("/")[2]
        for folder in ["/data", "/rec"]:
            assert guest.sh(f"grep ' {folder} ' /proc/mounts").startswith(f"/dev/{name}")
        root = guest.sh("mountpoint -d /")
        assert guest.sh(f"readlink -f /sys/dev/block/{root}").startswith(f"{disk}/")
        assert not [line for line in guest.sh("cat /run/log/boot").splitlines() if line.split()[2] != "0"]
        assert "I/O error" not in guest.sh("dmesg")
