# SPDX-License-Identifier: GPL-2.0-or-later
"""Services run as their own users and are restarted."""
import time

import pytest

from parts.guest import session
from parts.guest.qemu import Guest

from .test_control import runs
from .test_health import hang

pytestmark = pytest.mark.retry

SUPERVISE = "/run/service/ddxvideosave/supervise"
USERS = {"ddxstore": "ddxstore", "ddxvideosave": "ddxsave"}


def status(guest: Guest, program: str) -> tuple[int, dict[str, str]]:
    code, text = guest.shell().run(f"/etc/init.d/S*{program} status")
    words = text.split()
    assert words[0] == program
    return code, dict(word.split("=", 1) for word in words[1:])


def test_run_as_their_own_users(guest: Guest, recorded: session.Result) -> None:
    for program, user in USERS.items():
        code, fields = status(guest, program)
        assert code == 0 and fields["enabled"] == "yes" and fields["state"] == "running", program
        ids = guest.sh(f"grep -E '^(Uid|Gid|Groups):' /proc/{fields['pid']}/status")
        assert guest.sh(f"stat -c %U /proc/{fields['pid']}") == user
        assert "\t0\t" not in ids and "900" in ids


def test_no_service_died_while_recording(guest: Guest, recorded: session.Result) -> None:
    for program in [*USERS, "ddxvideoload"]:
        assert status(guest, program)[1]["restarts"] == "0", program


def test_the_finished_loader_is_not_restarted(guest: Guest, recorded: session.Result) -> None:
    code, fields = status(guest, "ddxvideoload")
    assert (code, fields["state"]) == (3, "complete")


def test_stop_and_start(guest: Guest, recorded: session.Result) -> None:
    guest.sh("/etc/init.d/S*ddxvideosave stop")
    code, fields = status(guest, "ddxvideosave")
    assert (code, fields["state"], fields["pid"]) == (3, "stopped", "-")
    guest.sh("/etc/init.d/S*ddxvideosave start")
    runs(guest, "ddxvideosave")


def test_a_killed_service_is_back_within_a_second_and_counted(guest: Guest, recorded: session.Result) -> None:
    """Killed after ten seconds. Judged are count and process; the time goes to the budget's table."""
    before = status(guest, "ddxvideosave")[1]
    guest.sh(f"sleep 10; kill -9 {before['pid']}")
    guest.wait_until(f"! [ \"$(cat {SUPERVISE}/pid)\" = {before['pid']} ] && [ -s {SUPERVISE}/pid ]")
    runs(guest, "ddxvideosave")
    after = status(guest, "ddxvideosave")[1]
    assert after["pid"] != before["pid"]
    assert int(after["restarts"]) == int(before["restarts"]) + 1


def test_a_new_worker_of_the_store_takes_over(guest: Guest, recorded: session.Result) -> None:
    """The store stays the same: the service has not stopped, and no other service is affected."""
    before = status(guest, "ddxstore")[1]
    worker = guest.sh(f"pgrep -P {before['pid']}").strip()
    guest.sh(f"kill -9 {worker}")
    guest.wait_until(f"now=$(pgrep -P {before['pid']}) && [ $now != {worker} ]")
    assert "the worker was killed by signal 9; the next one continues" in guest.sh("ddxctl logs ddxstore")
    assert "video" in guest.sh("ddxctl list")
    after = status(guest, "ddxstore")[1]
    assert (after["pid"], after["restarts"]) == (before["pid"], before["restarts"])
    assert guest.sh(f"stat -c %U /proc/$(pgrep -P {before['pid']})") == USERS["ddxstore"]


def test_a_service_that_hangs_is_replaced(guest: Guest, recorded: session.Result) -> None:
    """Without a recording; test_health.py does it with a clip and counts the losses."""
    print(f"replaced after {hang(guest, 'ddxvideosave'):.1f} s")


def test_a_stopped_process_does_not_block_the_stop(guest: Guest, recorded: session.Result) -> None:
    pid = status(guest, "ddxvideosave")[1]["pid"]
    guest.sh(f"kill -STOP {pid}")
    begin = time.monotonic()
    guest.sh("/etc/init.d/S*ddxvideosave stop")
    print(f"stopped after {time.monotonic() - begin:.1f} s")  # wanted: 5
    assert guest.shell().run(f"test -d /proc/{pid}")[0] != 0
    guest.sh("/etc/init.d/S*ddxvideosave start")


def test_settings_override_defaults_and_are_not_run_as_shell_code(guest: Guest, recorded: session.Result) -> None:
    evil = "$(touch /tmp/evil)`touch /tmp/evil`;touch /tmp/evil'"
    file = "/data/ddx/ddxvideosave.conf"
    guest.sh(f"printf '%s\\n' 'enabled=no' 'touch /tmp/evil' > {file}")
    assert "SKIP" in guest.sh("/etc/init.d/S*ddxvideosave stop; /etc/init.d/S*ddxvideosave start")
    assert status(guest, "ddxvideosave")[1]["enabled"] == "no"
    quoted = "'" + evil.replace("'", "'\\''") + "'"
    guest.sh(f"printf '%s\\n' name={quoted} > {file}; /etc/init.d/S*ddxvideosave restart")
    guest.wait_until("ps -o args | grep -q -- '-nam[e]'")  # started with these settings
    assert guest.shell().run("ls /tmp/evil")[0] != 0
    guest.sh(f"rm {file}; /etc/init.d/S*ddxvideosave restart")


def test_disabled_loader_without_test_disk(closed: Guest) -> None:
    closed.wait_for_log(b"Starting ddxvideosave")
    assert b"Starting ddxvideoload: SKIP" in closed.log.read_bytes()
