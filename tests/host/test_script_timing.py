# SPDX-License-Identifier: GPL-2.0-or-later
"""Races in the image's scripts, which are too rare in boots."""
from __future__ import annotations

import fcntl
import pathlib
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from parts.common import TOP

from .appliance import Appliance
from .programs import wait_until

pytestmark = pytest.mark.retry

THING = "run/service/thing"


@pytest.fixture
def appliance(tmp_path: pathlib.Path) -> Iterator[Appliance]:
    appliance = Appliance(tmp_path)
    yield appliance
    appliance.end()


@pytest.fixture
def service(appliance: Appliance) -> Appliance:
    """A service that was started, but has no runsv yet."""
    appliance.install_service()
    appliance.add("usr/bin/thing", "#!/bin/sh\nexec sleep 1000\n")
    (appliance.root / "etc/default/thing").write_text("user=root\n")
    assert run_action(appliance, "start") == "Starting thing: OK\n"
    return appliance


def run_action(appliance: Appliance, action: str) -> str:
    return appliance.run(f"/usr/libexec/ddx/service thing {action}")[1]


def state(appliance: Appliance) -> str:
    return dict(word.split("=") for word in run_action(appliance, "status").split()[1:])["state"]


@contextmanager
def starting_runsv(service: Appliance) -> Iterator[None]:
    """A runsv that has read `down` and waits for its logger's lock; at the end it reads commands."""
    folder = service.root / THING / "log/supervise"
    folder.mkdir()
    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        service.start("cd /run/service && exec runsv thing")
        wait_until((service.root / THING / "supervise/lock").exists)
        yield
    wait_until(lambda: service.run("sv status /run/service/thing")[0] == 0)


def test_a_stop_reaches_a_runsv_that_is_starting(service: Appliance) -> None:
    with starting_runsv(service):
        stop = service.start("/usr/libexec/ddx/service thing stop")
        wait_until((service.root / THING / "down").exists)
    assert stop.communicate(timeout=30)[0] == "Stopping thing: OK\n"
    assert state(service) == "stopped"


def test_a_start_reaches_a_runsv_that_is_starting(service: Appliance) -> None:
    run_action(service, "stop")
    with starting_runsv(service):
        start = service.start("/usr/libexec/ddx/service thing start")
        wait_until(lambda: not (service.root / THING / "down").exists())
    assert start.communicate(timeout=30)[0] == "Starting thing: OK\n"
    wait_until(lambda: state(service) == "running")


def test_without_a_runsv_nothing_is_waited_for(service: Appliance) -> None:
    assert run_action(service, "stop") == "Stopping thing: OK\n" and state(service) == "stopped"
    assert run_action(service, "start") == "Starting thing: OK\n" and state(service) == "starting"


@pytest.mark.parametrize("begin", ["", "\n", "soon 1.0\n", None])
def test_a_program_with_unknown_start_time_is_delayed(service: Appliance, begin: str | None) -> None:
    """/run was full, or it exited too early: it is counted, and not restarted in a fast loop."""
    folder = service.root / THING
    (folder / "supervise/stat").write_text("finish, want up\n")
    if begin is not None:
        (folder / "begin").write_text(begin)
    for restarts, delay in enumerate(["0", "1"], start=1):
        status, text = service.run(f"cd /{THING} && ./finish 1 0")
        assert (status, text) == (0, "")
        assert (folder / "restarts").read_text() == f"{restarts}\n" and (folder / "delay").read_text() == f"{delay}\n"


NOT_DONE = "ddxgrow: not done, the next boot continues"


@pytest.mark.parametrize("table, files, last", [(0, 0, "ddxgrow: done"), (0, 1, NOT_DONE), (1, 0, NOT_DONE)])
def test_growing_reports_when_it_is_done(appliance: Appliance, table: int, files: int, last: str) -> None:
    appliance.install("package/ddxgrow/grow", "usr/libexec/ddx/grow")
    appliance.add("usr/sbin/ddxgrow", f'#!/bin/sh\necho "table $*"\nexit {table}\n')
    appliance.add("usr/sbin/resize2fs", f'#!/bin/sh\nusleep 300000\necho "files $*"\nexit {files}\n')
    (appliance.root / "rec").mkdir()
    (appliance.root / "sys/devices/sda/sda6").mkdir(parents=True)
    (appliance.root / "sys/devices/sda/sda6/partition").write_text("6\n")
    (appliance.root / "sys/class/block").mkdir(parents=True)
    (appliance.root / "sys/class/block/sda6").symlink_to("../../devices/sda/sda6")
    status, text = appliance.run("mount -t tmpfs /dev/sda6 /rec && /usr/libexec/ddx/grow")
    assert (status, text.splitlines()) == (0, ["table /dev/sda 6", "files /dev/sda6", last])


def test_a_script_that_hangs_delays_the_boot_for_a_limited_time(appliance: Appliance) -> None:
    text = (TOP / "overlay/etc/init.d/rcS").read_text()
    assert "sleep 5" in text and "-ge 90" in text
    appliance.add("etc/init.d/rcS", text.replace("sleep 5", "sleep 0.2").replace("-ge 90", "-ge 1"))
    appliance.add("usr/libexec/ddx/serial", "#!/bin/sh\nexec cat\n")
    # A slot that has come up does not wait for the late work.
    appliance.add("usr/libexec/ddx/slot-came-up", "#!/bin/sh\n[ -e /run/late.done ] || echo up\necho > /run/up\n")
    appliance.add("usr/libexec/ddx/late", '#!/bin/sh\ntries=0\nuntil [ -e /run/up ] || [ "$((tries += 1))" -gt 50 ]\n'
                  "do usleep 100000; done\necho > /run/late.done\n")
    appliance.add("etc/init.d/S10first", "#!/bin/sh\necho first\n")
    appliance.add("etc/init.d/S20hangs", "#!/bin/sh\necho second\nsleep 1000\necho never\n")
    appliance.add("etc/init.d/S30last", "#!/bin/sh\necho last\nfalse\n")
    status, text = appliance.run("/etc/init.d/rcS && pkill sleep")
    said = [line for line in text.splitlines() if line not in ("Killed", "Terminated")]  # the shell's messages
    assert (status, said) == (0, ["first", "second", "FAIL: S20hangs takes too long", "last", "up"])
    boot = [line.split()[2:4] for line in (appliance.root / "run/log/boot").read_text().splitlines()]
    assert boot == [["0", "S10first"], ["137", "S20hangs"], ["1", "S30last"]]
    assert not (appliance.root / "run/said").exists()


def supervise(service: Appliance) -> None:
    """Start a runsv that no other process waits for, so that a test may freeze it."""
    service.run("cd /run/service && runsv thing > /dev/null 2>&1 &")
    wait_until(lambda: service.run("sv status /run/service/thing")[0] == 0)


def set_program(service: Appliance, text: str) -> None:
    """Replace the service's program from its next start on; each start adds a line to /run/starts."""
    new = service.root / "usr/bin/thing.new"
    new.write_text(f"#!/bin/sh\necho >> /run/starts\n{text}\n")
    new.chmod(0o755)
    new.rename(service.root / "usr/bin/thing")


def starts(service: Appliance) -> int:
    file = service.root / "run/starts"
    return len(file.read_text().splitlines()) if file.exists() else 0


def kill_program(service: Appliance) -> None:
    """Kill the service's program, which may not have executed `sleep` yet."""
    wait_until(lambda: service.run("killall sleep")[0] == 0)


@pytest.fixture
def supervised(service: Appliance) -> Appliance:
    set_program(service, "exec sleep 1000")
    supervise(service)
    wait_until(lambda: starts(service) == 1)
    return service


def test_toggles_within_a_second_take_effect_in_order(supervised: Appliance) -> None:
    """After a program that ran for less than a second, runsv sleeps for a second."""
    run_action(supervised, "stop")
    for _ in range(4):
        before = starts(supervised)
        run_action(supervised, "start")
        run_action(supervised, "stop")
        assert supervised.run("pidof sleep")[0] != 0
        assert starts(supervised) <= before + 1  # no start after its own stop
    run_action(supervised, "start")
    wait_until(lambda: state(supervised) == "running")
    assert (supervised.root / THING / "restarts").read_text() == "0\n"  # nothing died


def test_a_restart_of_a_service_that_dies_at_once_starts_it(supervised: Appliance) -> None:
    """Requested while its runsv sleeps before the next start."""
    set_program(supervised, "exit 1")
    kill_program(supervised)
    runsv = supervised.run("pidof runsv")[1].strip()
    wait_until(lambda: (supervised.root / THING / "supervise/stat").read_text() == "down\n")
    supervised.run(f"kill -STOP {runsv}")
    set_program(supervised, "exec sleep 1000")
    restart = supervised.start("/usr/libexec/ddx/service thing restart")
    wait_until(lambda: restart.poll() is not None or (supervised.root / THING / "down").exists())
    time.sleep(0.3)  # a script that did not wait would be done
    supervised.run(f"kill -CONT {runsv}")
    assert restart.communicate(timeout=30)[0] == "Stopping thing: OK\nStarting thing: OK\n"
    wait_until(lambda: state(supervised) == "running")


def test_nothing_waits_for_a_back_off(supervised: Appliance) -> None:
    """Neither a stop nor a start after a correction waits the eight seconds."""
    for action, result in (("stop", "stopped"), ("start", "running")):
        run_action(supervised, "start")
        wait_until(lambda: state(supervised) == "running")
        (supervised.root / THING / "delay").write_text("4\n")
        kill_program(supervised)
        wait_until(lambda: (supervised.root / THING / "delay").read_text() == "8\n")
        begin = time.monotonic()
        assert run_action(supervised, action).endswith(": OK\n")
        wait_until(lambda: state(supervised) == result)
        assert time.monotonic() - begin < 4
