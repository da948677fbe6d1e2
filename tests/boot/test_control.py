# SPDX-License-Identifier: GPL-2.0-or-later
"""ddxctl switches services on and off at once, for later boots, and for the next image."""
import json
import pathlib

import pytest

from parts.common import PATIENCE
from parts.guest import session
from parts.guest.qemu import Boot, Guest
from parts.image import tables

from .test_slots import fill_slot_b

pytestmark = pytest.mark.retry

SAVE, SEND, REAR = "ddxvideosave", "ddxvideosend", "ddxvideosend.rear"
KEY = "! update     updates may be signed with the development key, which is no secret"


def services(guest: Guest) -> dict[str, dict[str, object]]:
    found = [json.loads(line) for line in guest.sh("ddxctl services --json").splitlines()]
    return {one.pop("name"): one for one in found}


def run(guest: Guest, command: str) -> tuple[int, str]:
    status, text = guest.shell().run(command)
    return status, text.strip()


def runs(guest: Guest, name: str) -> None:
    """Wait until the service runs; runsvdir sees a new service folder within seconds."""
    guest.wait_until(f"ddxctl status {name} | grep -q state=running")


def test_services_are_those_of_the_tables(guest: Guest) -> None:
    found = services(guest)
    assert list(found) == tables.services()
    assert found["ddxstore"]["enabled"] is True and found["ddxstore"]["state"] == "running"
    assert found[SEND]["enabled"] is False and found[SEND]["pid"] is None
    table = guest.sh("ddxctl services").splitlines()
    assert table[0].split() == ["SERVICE", "ENABLED", "STATE", "PID", "RESTARTS"] and len(table) == len(found) + 1


def test_health_fits_one_screen_and_names_each_problem(guest: Guest, recorded: session.Result) -> None:
    status, screen = run(guest, "ddxctl health")
    lines = screen.splitlines()
    assert len(lines) <= 24 and all(len(line) <= 120 for line in lines)
    complaints = [line for line in lines if line.startswith("!")]
    assert complaints == ([KEY] if "dev.key" in guest.sh("ls /etc/ddx/update-keys") else [])
    assert status == (1 if complaints else 0)
    total, free = guest.sh("df -m /rec | tail -n 1").split()[1:4:2]
    assert f"  disk       /rec: {free} of {total} MB free" in lines
    assert f"  frames     {SAVE}: 0.0 in, 0.0 out a second, 0 lost" in lines
    assert any(line.startswith("  recorder   room for ") and "; files ready: " in line for line in lines)
    where = next(number for number, line in enumerate(lines) if line.startswith("  services   on: ddxstore"))
    assert lines[where + 1].startswith("             off: ") and SEND in lines[where + 1]
    guest.sh(f"ddxctl stop {SAVE} && mount -o remount,ro /rec")
    status, screen = run(guest, "ddxctl health")
    wrong = [line for line in screen.splitlines() if line.startswith("!") and line not in complaints]
    guest.sh(f"mount -o remount,rw /rec; ddxctl start {SAVE}")
    assert status == 1 and len(wrong) == 2, screen
    assert f"{SAVE} is stopped" in wrong[0] and "read-only" in wrong[1]


@pytest.mark.parametrize("lines, says", [
    ("enabled=off", f"/data/ddx/{SEND}.conf: line 1: enabled=off: yes or no is needed"),
    ("enabled=yes port=99999", "-port 99999: a number from 2 to 65532 is needed")])
def test_invalid_settings_are_reported_and_not_retried(guest: Guest, lines: str, says: str) -> None:
    file = f"/data/ddx/{SEND}.conf"
    guest.sh(f"printf '%s\\n' {lines} > {file}")
    run(guest, f"ddxctl start {SEND}")
    guest.wait_until(f"ddxctl status {SEND} | grep -q state=misconfigured")
    assert services(guest)[SEND]["restarts"] == 0
    guest.wait_until(f"ddxctl logs {SEND} | grep -qF -e '{says}'")
    assert f"! service    {SEND} is misconfigured; ddxctl logs {SEND}" in run(guest, "ddxctl health")[1]
    guest.sh(f"ddxctl disable {SEND}")  # also repairs the line
    assert services(guest)[SEND]["state"] == "stopped"
    guest.sh(f"rm {file}")


@pytest.mark.parametrize("words, says", [
    ("enable ddxvideo", "no service 'ddxvideo'; there are: ddxstore "),
    ("enable", "enable needs the name of a service: ddxstore "),
    ("disable ddxvideosend.side", "no 'ddxvideosend.side'; there are: ddxvideosend"),
    ("start ../etc/passwd", "no service"),
    ("status ddxstore extra", "unexpected 'extra'"),
    ("services all", "unexpected 'all'"),
    ("add ddxvideosend name=x", "add needs a name for the instance: ddxvideosend.front"),
    ("add ddxstore.two m=8M", "there can be only one ddxstore"),
    ("add ddxvideosend.a/b name=x", "letters, digits"),
    ("add ddxvideosend.rear rear", "'rear' is not key=value"),
    ("add ddxvideosend.rear port=99999", "-port 99999: a number from 2 to 65532 is needed"),
    ("add ddxvideosend.rear codec=h265", "-codec h265: h264 or mpeg4 is needed"),
    ("add ddxvideosend.rear speed=9", "there are: name codec wire bitrate "),
    ("remove ddxstore", "is part of the image"),
    ("reset", "needs a word: settings or everything"),
    ("reset all", "needs a word: settings or everything"),
    ("reset settings disks", "unexpected 'disks'; recordings is possible"),
])
def test_a_wrong_word_changes_nothing_and_valid_words_are_listed(guest: Guest, words: str, says: str) -> None:
    status, text = run(guest, f"ddxctl {words}")
    assert status == 2 and text.startswith("ddxctl: ") and says in text and len(text.splitlines()) == 1
    assert run(guest, f"ls -A /data/ddx | grep {SEND}")[0] == 1


@pytest.mark.long
def test_a_toggle_holds_now_after_a_boot_and_in_the_other_slot(boot: Boot, tmp_path: pathlib.Path) -> None:
    with boot("toggle", keep=tmp_path, prepare=fill_slot_b) as guest:
        guest.shell()
        assert services(guest)[SAVE]["state"] == "running"
        guest.sh(f"ddxctl disable {SAVE}")
        assert services(guest)[SAVE] == {"enabled": False, "state": "stopped", "pid": None, "restarts": 0}
        guest.sh(f"ddxctl add {REAR} name=rear port=8004 interface=lo bitrate=100")
        runs(guest, REAR)
        assert services(guest)[SEND]["enabled"] is False
        assert "-bitrate 100" in guest.sh("ps -o args | grep -- '-instanc[e] ddxvideosend.rear'")
        guest.wait_until(f"ddxctl logs {REAR} | grep -q rear")
        again, said = run(guest, f"ddxctl add {REAR} name=x")
        assert again == 2 and "is there already" in said
        guest.poweroff()
    with boot("toggled", keep=tmp_path) as guest:
        guest.shell()
        held(guest, "A")
        guest.sh(f"ddxctl disable {REAR} && ddxctl enable {REAR}")
        held(guest, "A")
        guest.poweroff()
    with boot("updated", keep=tmp_path, environment=("slot=B",)) as guest:
        guest.shell()
        held(guest, "B")
        guest.sh(f"ddxctl enable {SAVE}; ddxctl remove {REAR}")
        runs(guest, SAVE)
        after = services(guest)
        assert after[SAVE]["state"] == "running" and REAR not in after
        assert run(guest, "pidof ddxvideosend")[0] == 1 and run(guest, f"ls /run/service/{REAR}")[0] == 1
        guest.sh(f"ddxctl stop {SAVE}")
        assert run(guest, f"ddxctl status {SAVE}")[0] == 3
        guest.sh(f"ddxctl start {SAVE}")
        runs(guest, SAVE)


@pytest.mark.long
def test_a_reset_removes_settings_and_keeps_recordings(boot: Boot, tmp_path: pathlib.Path) -> None:
    with boot("reset", keep=tmp_path) as guest:
        guest.shell()
        guest.sh(f"ddxctl disable {SAVE}; ddxctl add {REAR} name=rear port=8004 interface=lo; echo x > /rec/old.y4m")
        runs(guest, REAR)
        store = guest.sh("cat /run/service/ddxstore/supervise/pid")
        for typed in ("", "yes", "everything"):
            status, text = run(guest, f"echo {typed} | ddxctl reset settings")
            assert status == 1 and "not confirmed" in text
        assert services(guest)[SAVE]["enabled"] is False
        guest.sh("echo settings | ddxctl reset settings")
        runs(guest, SAVE)
        found = services(guest)
        assert found[SAVE]["enabled"] is True and REAR not in found and run(guest, "pidof ddxvideosend")[0] == 1
        assert guest.sh("ls -A /data/ddx; cat /run/service/ddxstore/supervise/pid") == store
        guest.sh("mkdir /data/keys && echo secret > /data/keys/host && ls /rec/old.y4m")
        guest.shell().begin("echo everything | ddxctl reset everything recordings")
        guest.process.wait(PATIENCE)
    with boot("reset-everything", keep=tmp_path) as guest:
        left = guest.sh("ls -A /data /data/ddx /rec | grep -v -e lost+found -e pool -e '^log$' -e '^.ddx$' | xargs")
        assert left == "/data: ddx /data/ddx: /rec:"
        assert services(guest)[SAVE]["state"] == "running"


def held(guest: Guest, slot: str) -> None:
    """Check that the toggles of the first boot still hold."""
    assert f"ddx.slot={slot}" in guest.sh("cat /proc/cmdline")
    runs(guest, REAR)
    found = services(guest)
    assert found[SAVE]["enabled"] is False and found[SAVE]["state"] == "stopped"
    assert found[REAR]["enabled"] is True
