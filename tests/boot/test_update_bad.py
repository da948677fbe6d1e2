# SPDX-License-Identifier: GPL-2.0-or-later
"""A bad version is taken back without help: the older one records again, and reports why."""
import dataclasses
import json
import pathlib

import pytest

from parts.common import run
from parts.disk.disk import Disk
from parts.guest import guest_camera, testdisk
from parts.guest.laptop import forward, free_port
from parts.guest.qemu import Boot

from . import slot_image
from .slot_image import DOG, RECORDS, SETTINGS, Change, remove, script
from .test_slots import SLOT

pytestmark = [pytest.mark.retry, pytest.mark.long]

# Its driver is a module of each board.
CARD = "e1000"
THRICE = "it was started three times, and each time it stopped or hung"


@dataclasses.dataclass(frozen=True)
class Bad:
    change: Change
    reasons: tuple[str, ...]  # one of them
    resets: int = 2           # from `start` on, until the older version runs
    report: bool = True


def hang(root: pathlib.Path) -> None:
    """The boot stops after S16update."""
    path = root / "etc/init.d/rcS"
    text = path.read_text()
    line = '\t[ -x "$script" ] || continue\n'
    assert text.count(line) == 1
    path.write_text(text.replace(line, f'{line}\t[ "${{script##*/}}" != S18network ] || sleep 100000\n'))


def crash(root: pathlib.Path) -> None:
    program = root / "usr/libexec/ddx/ddxupdate"
    program.rename(program.with_name("real"))
    program.touch()
    script(program, '[ "$1" != trial ] || kill -SEGV $$\nexec /usr/libexec/ddx/real "$@"')


IMAGES = {
    "kernel-damaged": Bad(lambda root: (root / "boot/vmlinuz").write_text("no kernel"),
                          ("the boot loader could not start slot B",), 1, report=False),
    "panic": Bad(lambda root: script(root / "sbin/init", "exit 1"), (THRICE,), 4, report=False),
    "init-hangs": Bad(hang, (THRICE,), 4, report=False),
    "store-dies": Bad(lambda root: script(root / "usr/bin/ddxstore", "sleep 1; exit 1"),
                      ("ddxstore does not run",
                       "ddxstore died and had to be started again", "the store does not answer")),
    "recorder-hangs": Bad(lambda root: script(root / "usr/bin/ddxvideosave", 'case "$*" in *-check*) exit 0; esac\n'
                                              "exec sleep 100000"), ("ddxvideosave: no new frame",)),
    "no-network-driver": Bad(lambda root: remove(root, f"{CARD}.ko*"),
                             ("the network interface eth0 is missing",)),
    "no-ssh": Bad(lambda root: remove(root, "dropbear"), ("SSH does not answer",)),
    "trial-crashes": Bad(crash, ("its trial failed (exit status 139)",)),
}


@pytest.mark.parametrize("bad", IMAGES.values(), ids=IMAGES)
def test_a_bad_version_is_taken_back(boot: Boot, root: pathlib.Path, tmp_path: pathlib.Path, clip: pathlib.Path,
                                     bad: Bad) -> None:
    image = slot_image.make(root, tmp_path / "bad.squashfs", bad.change)
    run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", tmp_path / "mine"])
    provision = f"network=eth0 dhcp\nssh_key={(tmp_path / 'mine.pub').read_text()}"
    disk = testdisk.make(tmp_path / "clip.img", clip, SETTINGS)

    def fill(disk: Disk) -> None:
        disk.write(SLOT["B"], image.read_bytes())

    with boot("bad", provision=provision, test_disk=disk, prepare=fill, extra=(*forward(free_port(), card=CARD), *DOG),
              more_memory=64) as guest:
        guest.shell()
        guest.wait_until(RECORDS)
        guest.wait_until("netstat -tln | grep -q :22 && grep -q eth0 /proc/net/route")
        guest.shell().begin("ddxctl update start")
        slot_image.wait_for_boots(guest, 1 + bad.resets, 900)
        guest.shell()
        assert "ddx.slot=A" in guest.sh("cat /proc/cmdline").split()
        status = json.loads(guest.sh("ddxctl update status --json"))
        assert status["last"] == "returned"
        assert status["reason"] in bad.reasons, guest.run("ddxctl update report")[1]
        guest.wait_until(RECORDS)
        health = guest.sh("ddxctl health || true")
        assert f"! update     version {slot_image.VERSION} was taken back: {status['reason']}" in health
        assert "! slot" not in health
        code, report = guest.run("ddxctl update report")
        assert (code == 0) == bad.report and ("messages: kernel" in report) == bad.report
        guest.wait_until("[ -e /run/slot.failed ]")
        assert guest.environment() == {"failed": "B"}
        guest.sh("ddxctl update seen")
        assert "was taken back" not in guest.sh("ddxctl health || true") and guest.environment() == {}


def with_camera(root: pathlib.Path) -> None:
    """The kernel's test camera is plugged in at each boot."""
    driver = root / "etc/init.d/S29camera"
    driver.touch()
    script(driver, '[ "$1" != start ] || modprobe vivid no_error_inj=0')


def without_driver(root: pathlib.Path) -> None:
    with_camera(root)
    remove(root, "vivid.ko*")


def test_a_version_without_the_camera_s_driver(boot: Boot, root: pathlib.Path, tmp_path: pathlib.Path) -> None:
    """Both slots are changed: the older version has the driver."""
    images = {"A": slot_image.make(root, tmp_path / "good.squashfs", with_camera),
              "B": slot_image.make(root, tmp_path / "bad.squashfs", without_driver)}
    disk = testdisk.make(tmp_path / "camera.img", None, {f"{guest_camera.GRABBER}.conf": guest_camera.LOOPED})
    flows = f"ddxctl stats --json | grep -q '\"instance\":\"{guest_camera.GRABBER}\",\"in\":[1-9]'"

    def fill(disk: Disk) -> None:
        for slot, image in images.items():
            disk.write(SLOT[slot], image.read_bytes())

    with boot("no-camera", test_disk=disk, prepare=fill, extra=DOG, more_memory=256) as guest:
        guest.shell()
        guest.wait_until(flows)
        guest.shell().begin("ddxctl update start")
        for slot in "BA":
            guest.wait_for_event("RESET", 900)
            guest.reset()
            guest.shell()
            assert f"ddx.slot={slot}" in guest.sh("cat /proc/cmdline").split()
        status = json.loads(guest.sh("ddxctl update status --json"))
        assert status["last"] == "returned"
        assert status["reason"] in (f"{guest_camera.GRABBER}: no new frame", "ddxvideosave: no new frame")
        guest.wait_until(flows)
