# SPDX-License-Identifier: GPL-2.0-or-later
"""The rights of each process as the kernel reports them, with every service switched on."""
import re

import pytest

from parts.common import wait_until
from parts.guest import session
from parts.guest.qemu import Guest

pytestmark = pytest.mark.retry

# Supervisors, mount scripts, the shells that the test's provisioning file opened, and `console` without input, which
# only waits.
ROOTS = {"init", "recordings-disk", "runsvdir", "runsv", "mdev", "sh", "console", "sleep", "grep", "readlink"}
# For milliseconds at its start a service is `run`, libexec/ddx/launch. BusyBox' timeout, which the tests use,
# stays for a second after its program.
PASSING = {"run", "timeout"}
REALTIME = {"ddxlog", "ddxvideoV4L", "ddxvideosave"}
SWITCHED_ON = ("ddxlog", "ddxvideosend", "ddxdecode", "ddxcatalog")
OWN = {"ddxstore": 901, "ddxstore-worker": 901, "ddxvideosave": 903, "ddxvideoV4L": 904, "ddxvideosend": 905,
       "ddxdecode": 906, "ddxhealth": 907, "svlogd": 908, "ddxlog": 909, "ddxcatalog": 914}
# SSH lets root in; the panel's processes are judged in tests/host/test_panel.py.
VISITED = {"dropbear", "ddxpanel"}
# Root's other processes in the network, and their capabilities (/usr/include/linux/capability.h).
ADDRESSES, TIME = 1 << 10 | 1 << 12 | 1 << 13, 1 << 25  # bind to low ports, administer, raw sockets; set the time
CONFINED = {"network": ADDRESSES, "udhcpc": ADDRESSES, "wifi": ADDRESSES, "wpa_supplicant": ADDRESSES, "ntpd": TIME}
JUDGED = "^(Name|Pid|Uid|Gid|Groups|Cap...|NoNewPrivs):"

Fields = dict[str, str]


def look(guest: Guest) -> list[Fields]:
    """The JUDGED lines in /proc/<pid>/status of each process except kernel threads, which have no program. Late work
    runs as root. All lines of all processes would be 200 KB, and QEMU drops what a busy host does not take in time.

    The wait is a loop of the shell: wait_until()'s `timeout` stays for a second, and each look would see it."""
    guest.sh("until [ -e /run/late.done ]; do sleep 0.5; done")
    show = f"readlink $p/exe > /dev/null && grep -HE '{JUDGED}' $p/status"
    text = guest.sh(f"for p in /proc/[0-9]*; do {show}; done; true")
    found: dict[str, Fields] = {}
    for pid, name, value in re.findall(r"^/proc/(\d+)/status:(\w+):[ \t]*(.*?)[ \t]*$", text, re.M):
        found.setdefault(pid, {})[name] = value
    return list(found.values())


def settled(guest: Guest) -> list[Fields]:
    """The same, once no service is at its start. A process that exits meanwhile has few lines, perhaps no name."""
    found: list[Fields] = []

    def looked() -> bool:
        found[:] = look(guest)
        return not any(one.get("Name", "run") in PASSING or "NoNewPrivs" not in one for one in found)

    wait_until(looked, "services that are still at their start", pause=1)
    return found


def unconfined(guest: Guest) -> tuple[set[str], list[str]]:
    """Root's confined processes by name, and those with more capabilities than they should have."""
    roots = [one for one in settled(guest) if one["Name"] not in ROOTS | VISITED and "0" in one["Uid"].split()]
    found = {one["Name"] for one in roots if one["Name"] in CONFINED}
    return found, [f"{one['Name']}: {one['CapPrm']}, {one['CapBnd']}" for one in roots
                   if {int(one[kind], 16) for kind in ("CapPrm", "CapEff", "CapBnd")} != {CONFINED.get(one["Name"])}
                   or int(one["CapAmb"], 16) or one["NoNewPrivs"] != "1"]


@pytest.fixture(scope="module")
def processes(guest: Guest, recorded: session.Result) -> list[Fields]:
    for one in SWITCHED_ON:
        guest.sh(f"ddxctl enable {one}")
        guest.wait_until(f"ddxctl status {one} | grep -q state=running")
    found = settled(guest)
    for one in SWITCHED_ON:
        guest.sh(f"ddxctl disable {one}; rm /data/ddx/{one}.conf")
    return found


def test_each_service_is_its_own_user(processes: list[Fields]) -> None:
    users = {one["Name"]: {int(number) for number in one["Uid"].split()} for one in processes}
    assert {name: users.get(name) for name in OWN} == {name: {number} for name, number in OWN.items()}


def test_only_supervisors_run_as_root(processes: list[Fields]) -> None:
    for one in processes:
        if one["Name"] not in ROOTS:
            assert "0" not in one["Uid"].split() + one["Gid"].split() + one["Groups"].split(), one["Name"]


def test_services_have_no_capabilities_and_cannot_gain_any(processes: list[Fields]) -> None:
    for one in processes:
        if one["Name"] not in ROOTS:
            held = [one[kind] for kind in ("CapInh", "CapPrm", "CapEff", "CapAmb")]
            assert set(held) == {"0" * 16} and one["NoNewPrivs"] == "1", one["Name"]
    root = next(one for one in processes if one["Name"] == "init")  # proves that the check can fail
    assert root["CapEff"] != "0" * 16 and root["NoNewPrivs"] == "0"


def fails_as(guest: Guest, user: str, command: str) -> bool:
    """Whether the command fails with that service's rights."""
    return guest.shell().run(f"chpst -u {user}:ddx sh -c '{command}' 2> /dev/null")[0] != 0


def test_a_service_cannot_remove_another_service_s_files(guest: Guest, processes: list[Fields]) -> None:
    """The group contains services that talk to the network."""
    assert guest.sh("stat -c '%U %G %a' /run/ddx /rec /rec/log").splitlines() == [
        "ddxstore ddx 3775", "ddxsave ddx 2755", "ddxlogger ddx 2755"]
    for user in ("ddxsend", "ddxdecode", "ddxgrab"):
        assert fails_as(guest, user, "mv /run/ddx/store-* /run/ddx/mine || rm -f /run/ddx/store-*"), user
        assert fails_as(guest, user, "touch /rec/x") and fails_as(guest, user, "touch /rec/log/x"), user
    assert not fails_as(guest, "ddxsend", "touch /run/ddx/own && rm /run/ddx/own")  # its own store
    assert not fails_as(guest, "ddxlogger", "touch /rec/log/x && rm /rec/log/x")


def test_store_and_recorder_are_killed_last_when_memory_is_short(guest: Guest, processes: list[Fields]) -> None:
    for one in processes:
        wanted = "-900" if one["Name"] in ("ddxstore", "ddxstore-worker", "ddxvideosave") else "0"
        status, text = guest.shell().run(f"cat /proc/{one['Pid']}/oom_score_adj")
        assert status != 0 or text.strip() == wanted, one["Name"]


def test_only_programs_that_would_lose_frames_have_real_time_priority(guest: Guest, processes: list[Fields]) -> None:
    """FIFO, without root, and for no other process."""
    for one in processes:
        if one["Name"] in ROOTS:
            continue
        status, text = guest.shell().run(f"chrt -p {one['Pid']}")
        if status == 0:  # otherwise the process has exited
            assert ("SCHED_FIFO" in text) == (one["Name"] in REALTIME), (one["Name"], text)
