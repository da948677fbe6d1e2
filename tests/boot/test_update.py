# SPDX-License-Identifier: GPL-2.0-or-later
"""A new version by SSH into the running machine: its trial begins, it is kept, and the machine goes back. The update is
the image's own root file system, with a shorter trial."""
import json
import pathlib
import subprocess

import pytest

import build
from parts.common import PATIENCE, run
from parts.guest.laptop import forward, free_port
from parts.guest.qemu import Boot, Guest
from parts.release import update_file

from . import slot_image

pytestmark = [pytest.mark.retry, pytest.mark.long]


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


def test_there_and_back(boot: Boot, image: pathlib.Path, root: pathlib.Path, tmp_path: pathlib.Path) -> None:
    if image != build.DEV / "disk.img":
        pytest.skip("the key of this image's updates is not here")
    new = slot_image.make(root, tmp_path / "new.squashfs")
    here, what = update_file.release(image.parent / "rootfs.squashfs"), update_file.release(new)
    file = tmp_path / "new.update"
    file.write_bytes(update_file.make(what, new.read_bytes(), build.UPDATE_KEY))
    run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", tmp_path / "mine"])
    port = free_port()
    provision = f"network=eth0 dhcp\nssh_key={(tmp_path / 'mine.pub').read_text()}"

    def ssh(command: str) -> "subprocess.CompletedProcess[str]":
        options = ["BatchMode=yes", "IdentitiesOnly=yes", f"IdentityFile={tmp_path / 'mine'}", "ConnectTimeout=30",
                   f"UserKnownHostsFile={tmp_path}/known_hosts", "StrictHostKeyChecking=accept-new", "LogLevel=ERROR"]
        words = [part for word in options for part in ("-o", word)]
        with file.open("rb") as source:
            return subprocess.run(["ssh", "-F", "none", *words, "-p", str(port), "root@127.0.0.1", command],
                                  stdin=source, capture_output=True, text=True, check=False, timeout=PATIENCE)

    with boot("update", provision=provision, extra=(*forward(port), "-action", "reboot=reset")) as guest:
        guest.shell()
        guest.wait_until("netstat -tln | grep -q :22")
        assert "slot B has no version" in guest.sh("ddxctl update start || true")
        done = ssh("ddxctl update -")
        assert (done.returncode, done.stderr) == (0, ""), done
        assert done.stdout == "slot B: version 9.9.9 (new); `ddxctl update start` restarts into it\n"
        size = new.stat().st_size
        read = f"dd if=$(/usr/libexec/ddx/own-partition 3) bs=4096 count={size // 4096} 2> /dev/null | sha256sum"
        assert guest.sh(read).split()[0] == run(["sha256sum", new]).split()[0]
        guest.shell().begin("ddxctl update start")
        restarted(guest, "B")
        status = json.loads(guest.sh("ddxctl update status --json"))
        slots = {slot: {"version": one.version, "serial": int(one.serial)} for slot, one in (("A", here), ("B", what))}
        assert status == {"running": "B", "chosen": "B", "last": "kept", "reason": "", "trial": "", "slots": slots}
        guest.shell().begin("ddxctl update back")
        restarted(guest, "A")
