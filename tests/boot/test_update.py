# SPDX-License-Identifier: GPL-2.0-or-later
"""A new version by SSH into the running machine: its trial begins, it is kept, and the machine goes back. The update is
the image's own root file system, with a shorter trial. FROM=disk.img: the machine was flashed with this image, such as
one of an older version that trusts the key in output/update. A connection that breaks and a stick that is pulled out
leave no version that could be started."""
import json
import os
import pathlib
import subprocess
from collections.abc import Sequence

import pytest

from lib.figures import Figure, uptime
from parts.common import MORTAL, PATIENCE, run
from parts.disk import mbr
from parts.guest import testdisk
from parts.guest.laptop import forward, free_port
from parts.guest.machine import Machine
from parts.guest.qemu import Boot, Guest
from parts.media import counters
from parts.processes import kill
from parts.release import update_file

from . import slot_image

pytestmark = [pytest.mark.retry, pytest.mark.long]

FROM = os.environ.get("FROM", "")


def restarted(guest: Guest, slot: str) -> None:
    slot_image.wait_for_boots(guest, 2 if slot == "B" else 3)
    guest.shell()
    words = guest.sh("cat /proc/cmdline").split()
    assert f"ddx.slot={slot}" in words and "ddx.layout=1" in words
    guest.wait_until("ddxctl health | grep -q 'this version is on trial'")
    if slot == "A":  # its trial takes five minutes
        assert guest.sh("ddxctl update keep") == "this version is kept"
    block = {"slot": "B"} if slot == "B" else {}
    guest.wait_until(f"[ \"$(cat /data/update | sed -n 's/^proven=//p')\" = {slot} ]")
    assert guest.environment() == block
    guest.wait_until("ddxctl status ddxvideosave | grep -q state=running")


def slot_a(image: pathlib.Path, folder: pathlib.Path) -> update_file.Release:
    part, file = mbr.partition(image, 2), folder / "slot"
    with image.open("rb") as source:
        source.seek(part.begin)
        file.write_bytes(source.read(part.end - part.begin))
    return update_file.release(file)


def slot_b_has(guest: Guest, new: pathlib.Path) -> bool:
    read = f"dd if=$(/usr/libexec/ddx/own-partition 3) bs=4096 count={new.stat().st_size // 4096} 2> /dev/null"
    return guest.sh(f"{read} | sha256sum").split()[0] == run(["sha256sum", new]).split()[0]


def wait_for_second_mib(guest: Guest) -> None:
    """Until a part of the update is on the disk; slot B is empty before."""
    guest.wait_until("[ -n \"$(dd if=$(/usr/libexec/ddx/own-partition 3) bs=1M skip=1 count=1 iflag=direct "
                     "2> /dev/null | tr -d '\\0' | head -c 1)\" ]")


class Laptop:
    """Its `ssh`, for a guest that knows its key."""

    def __init__(self, folder: pathlib.Path) -> None:
        run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", folder / "mine"])
        self.port = free_port()
        self.provision = f"network=eth0 dhcp\nssh_key={(folder / 'mine.pub').read_text()}"
        options = ["BatchMode=yes", "IdentitiesOnly=yes", f"IdentityFile={folder / 'mine'}", "ConnectTimeout=30",
                   f"UserKnownHostsFile={folder}/known_hosts", "StrictHostKeyChecking=accept-new", "LogLevel=ERROR"]
        words = [part for word in options for part in ("-o", word)]
        self.words: Sequence[str] = ["ssh", "-F", "none", *words, "-p", str(self.port), "root@127.0.0.1"]

    def run(self, command: str, file: pathlib.Path) -> "subprocess.CompletedProcess[str]":
        with file.open("rb") as source:
            return subprocess.run([*self.words, command], stdin=source, capture_output=True, text=True, check=False,
                                  timeout=PATIENCE)

    def breaks_off(self, command: str, file: pathlib.Path, guest: Guest) -> None:
        """The connection is cut in the middle of the update."""
        with file.open("rb") as source, subprocess.Popen([*MORTAL, *self.words, command], stdin=source,
                                                         stdout=subprocess.DEVNULL) as process:
            wait_for_second_mib(guest)
            kill(process)
        guest.wait_until("! pidof ddxupdate > /dev/null")


@pytest.mark.parametrize("older", [FROM], ids=["older" if FROM else "same"])
def test_there_and_back(image: pathlib.Path, root: pathlib.Path, board: Machine, accel: str, work: pathlib.Path,
                        tmp_path: pathlib.Path, older: str) -> None:
    new, file = slot_image.update(root, tmp_path)
    flashed, laptop = pathlib.Path(older or image), Laptop(tmp_path)
    here, what = slot_a(flashed, tmp_path), update_file.release(new)
    with Guest(flashed, accel, board, log=work / f"update.{board.firmware}.log", provision=laptop.provision,
               extra=(*forward(laptop.port), "-action", "reboot=reset")) as guest:
        guest.shell()
        guest.wait_until("netstat -tln | grep -q :22")
        laptop.breaks_off("ddxctl update -", file, guest)
        assert "slot B has no version" in guest.sh("ddxctl update start || true")
        done = laptop.run("ddxctl update -", file)
        assert (done.returncode, done.stderr) == (0, ""), done
        assert done.stdout == "slot B: version 9.9.9 (new); `ddxctl update start` restarts into it\n"
        assert slot_b_has(guest, new)
        guest.shell().begin("ddxctl update start")
        restarted(guest, "B")
        status = json.loads(guest.sh("ddxctl update status --json"))
        slots = {slot: {"version": one.version, "serial": int(one.serial)} for slot, one in (("A", here), ("B", what))}
        assert status == {"running": "B", "chosen": "B", "last": "kept", "reason": "", "trial": "", "slots": slots}
        guest.shell().begin("ddxctl update back")
        restarted(guest, "A")


def test_a_stick_that_is_pulled_out(boot: Boot, root: pathlib.Path, tmp_path: pathlib.Path) -> None:
    """The stick is plugged in again, and the update goes on."""
    new, file = slot_image.update(root, tmp_path)
    stick = tmp_path / "stick.img"
    run(["mkfs.vfat", "-C", stick, str(96 << 10)])
    run(["mcopy", "-i", stick, file, "::/robot.update"])
    extra = ("-device", "qemu-xhci,id=usb", "-blockdev", f"driver=file,node-name=file,filename={stick}", "-blockdev",
             "driver=raw,node-name=stick,file=file")

    def plug(guest: Guest) -> None:
        guest.monitor("device_add", driver="usb-storage", id="stick", bus="usb.0", drive="stick", removable=True)
        guest.wait_until("blkid | grep -q '/dev/sda.*TYPE=\"vfat\"'")

    with boot("stick", extra=extra) as guest:
        guest.shell()
        plug(guest)
        guest.sh("(ddxctl update usb; echo status $?) > /run/said 2>&1 &")
        wait_for_second_mib(guest)
        guest.monitor("device_del", id="stick")
        guest.wait_until("grep -q status /run/said")
        said = [line for line in guest.sh("cat /run/said").splitlines() if "may be removed" not in line]
        assert said[-1] == "status 1" and said[-2].startswith("ddxupdate: ")
        guest.wait_until("! grep -q /run/update /proc/mounts && [ ! -e /dev/sda ]")
        assert "slot B has no version" in guest.sh("ddxctl update start || true")
        plug(guest)
        assert guest.run("ddxctl update usb", 2 * PATIENCE)[1].splitlines() == [
            f"slot B: version {slot_image.VERSION}; `ddxctl update start` restarts into it",
            "/dev/sda: may be removed"]
        assert slot_b_has(guest, new)


def recorded(guest: Guest) -> counters.Counters:
    return counters.of("ddxvideosave", guest.sh("ddxctl stats --json"))[0]


def test_no_frame_is_lost_on_a_slow_card(image: pathlib.Path, root: pathlib.Path, board: Machine, accel: str,
                                         work: pathlib.Path, clip: pathlib.Path, tmp_path: pathlib.Path,
                                         record_property: Figure) -> None:
    """CIF at 25 Hz is recorded onto the card that takes the update: 20 MB and 100 requests a second at most."""
    _, file = slot_image.update(root, tmp_path)
    disk = testdisk.make(tmp_path / "clip.img", clip, {"ddxvideoload.conf": "loop=\nreaders=1\n", "new.update": file,
                                                       "ddxvideosave.conf": "segment=8\nfull=recycle\n"})
    with Guest(image, accel, board, log=work / f"slow-card.{board.firmware}.log", test_disk=disk, more_memory=64,
               limits="x-bps-total=20000000,x-iops-total=100") as guest:
        guest.shell()
        guest.wait_until("ddxctl stats --json | grep -q '\"instance\":\"ddxvideosave\",\"in\":[1-9]'")
        before = recorded(guest)
        begin = uptime(guest)
        guest.run("ddxctl update /test/new.update", 3 * PATIENCE)
        record_property("seconds", uptime(guest) - begin)
        after = recorded(guest)
        record_property("frames", after.out - before.out)
        record_property("lost", after.lost_total - before.lost_total)
        assert after.lost_total == before.lost_total and after.out > before.out
        assert json.loads(guest.sh("ddxctl update status --json"))["slots"]["B"]["version"] == slot_image.VERSION
