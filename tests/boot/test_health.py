# SPDX-License-Identifier: GPL-2.0-or-later
"""A program that hangs is killed and restarted, its losses are counted, and a machine that does not recover is reset by
its watchdog."""
import pathlib
import time
from collections.abc import Iterator

import pytest

from lib.figures import Figure, uptime
from parts.guest import session, testdisk
from parts.guest.qemu import Boot, Guest
from parts.media.recording import FileSystem

from . import camera

pytestmark = pytest.mark.retry

SAVE, HEALTH = "ddxvideosave", "ddxhealth"
BACK = 30.0    # s until a program that hangs is replaced; the goal is 10, but emulated machines are slow
TIMEOUT = 20   # s; the watchdog's
# QEMU's hardware watchdog; the machine does start again
DOG = ("-device", "i6300esb", "-action", "reboot=reset,watchdog=reset")
FED = f'grep -q "after {TIMEOUT} s" /run/log/{HEALTH}/current'  # ddxhealth feeds the watchdog


def state(guest: Guest, name: str) -> dict[str, str]:
    text = guest.shell().run(f"ddxctl status {name}")[1].split()
    return dict(word.split("=", 1) for word in text[1:])


def hang(guest: Guest, name: str) -> float:
    """SIGSTOP the service; return the seconds until another process has replaced it."""
    old = state(guest, name)
    assert old["state"] == "running"
    begin = uptime(guest)
    guest.sh(f"kill -STOP {old['pid']} $(pgrep -P {old['pid']})")  # also a store's worker
    supervise = f"/run/service/{name}/supervise"
    guest.wait_until(f"read -r pid < {supervise}/pid && [ ${{pid:-{old['pid']}}} != {old['pid']} ]", pause=0.1)
    guest.wait_until(f"ddxctl status {name} | grep -q state=running", pause=0.1)
    now = state(guest, name)
    assert int(now["restarts"]) == int(old["restarts"]) + 1
    assert f"{name}: no sign of life from process {old['pid']}, killed" in guest.sh(f"cat /run/log/{HEALTH}/current")
    return uptime(guest) - begin


def pictures(guest: Guest, work: pathlib.Path) -> list[int]:
    """The frame numbers in all recordings, in order."""
    partition = FileSystem(guest.snapshot())
    found: list[int] = []
    for names in partition.recordings():
        file = partition.take_all(names, work / "pictures.y4m")
        found += [-1 if number is None else number for number in camera.numbers(file)]
        file.unlink()
    return found


@pytest.mark.strict
@pytest.mark.long
def test_a_recorder_that_hangs_is_replaced_and_its_loss_is_counted(
        boot: Boot, work: pathlib.Path, clip: pathlib.Path, record_property: Figure) -> None:
    disk = testdisk.make(work / "health.img", clip, {"ddxvideoload.conf": "readers=1\n"})
    with boot("hang", test_disk=disk) as guest:
        camera.wait_for_frames(guest, 50, session.LOAD)
        took = hang(guest, SAVE)
        session.wait_for_clip(guest, 500)
        session.stop_recorder(guest)
        load, save = (session.end_counters(guest, one) for one in (session.LOAD, SAVE))
        shown = pictures(guest, work)
    record_property("seconds_until_replaced", round(took, 1))
    record_property("lost", save.lost)
    assert took < BACK
    assert save.frames_in == load.out == 500
    assert save.out + save.lost_total == save.frames_in
    assert save.lost["restart"] > 100
    assert shown == sorted(set(shown)) and len(shown) == save.out  # the counted losses are those missing in the files


@pytest.mark.long
def test_a_store_that_hangs_is_replaced_and_nothing_is_lost(
        boot: Boot, work: pathlib.Path, clip: pathlib.Path, record_property: Figure) -> None:
    disk = testdisk.make(work / "health.img", clip, {"ddxvideoload.conf": "readers=1\n"})
    with boot("hang-store", test_disk=disk) as guest:
        camera.wait_for_frames(guest, 50, session.LOAD)
        took = hang(guest, "ddxstore")
        session.wait_for_clip(guest, 500)
        session.stop_recorder(guest)
        result = session.collect(guest, clip, work / "hang-store.y4m")
        others = {name: state(guest, name)["restarts"] for name in (SAVE, HEALTH)}
    record_property("seconds_until_replaced", round(took, 1))
    assert took < BACK and result.good, result.disagreements
    assert set(others.values()) == {"0"}


@pytest.fixture(scope="module")
def guarded(boot: Boot, work: pathlib.Path) -> Iterator[Guest]:
    disk = testdisk.make(work / "dog.img", None, {f"{HEALTH}.conf": f"timeout={TIMEOUT}\n"})
    with boot("dog", test_disk=disk, extra=DOG) as guest:
        guest.shell()
        guest.wait_until(FED)
        yield guest


def boots(guest: Guest) -> int:
    return guest.log.read_bytes().count(b"Starting base")


@pytest.mark.long
def test_the_watchdog_is_fed_also_while_programs_hang(guarded: Guest) -> None:
    begin = time.monotonic()
    hang(guarded, "ddxstore")
    hang(guarded, SAVE)
    time.sleep(max(0.0, begin + 1.5 * TIMEOUT - time.monotonic()))
    assert boots(guarded) == 1
    health = guarded.shell().run("ddxctl health")[1]
    assert f"watchdog   i6300ESB timer, {TIMEOUT} s, active" in health and "! last boot" not in health


@pytest.mark.long
def test_a_service_that_dies_repeatedly_is_delayed_and_reported(guarded: Guest) -> None:
    """A recorder without its disk is restarted at once, then after 1, 2, 4, 8, 8 ... s."""
    bad = f"{SAVE}.bad"
    guarded.sh(f"printf 'enabled=yes\\noutput=/none/such\\n' > /data/ddx/{bad}.conf")
    guarded.sh(f"ddxctl start {bad}; sleep 20")
    assert 4 <= int(state(guarded, bad)["restarts"]) <= 7
    status, screen = guarded.shell().run("ddxctl health")
    assert status == 1 and f"! service    {bad}" in screen
    assert "name a file or a folder that can be written" in guarded.sh(f"ddxctl logs {bad}")
    guarded.sh(f"ddxctl remove {bad}")
    assert boots(guarded) == 1


@pytest.mark.long
def test_a_recorder_that_cannot_be_restarted_causes_a_reset(guarded: Guest, record_property: Figure) -> None:
    """Its frozen supervisor cannot kill it, so the watchdog is no longer fed."""
    guarded.wait_until(f"ddxctl stats --json | grep -q '\"instance\":\"{SAVE}\"'")
    runsv = guarded.sh(f"pgrep -x -f 'runsv {SAVE}'")
    guarded.shell().begin(f"kill -STOP {runsv} {state(guarded, SAVE)['pid']}")
    begin = time.monotonic()
    guarded.wait_for_event("WATCHDOG")
    record_property("seconds_until_reset", round(time.monotonic() - begin, 1))
    guarded.reset()
    health = guarded.shell().run("ddxctl health")[1]
    assert "! last boot  the watchdog had reset the machine" in health
    guarded.wait_until(FED)


@pytest.mark.long
def test_a_dead_machine_is_reset_and_health_reports_it(guarded: Guest, record_property: Figure) -> None:
    """The kernel runs, but the watchdog is not fed: QEMU reports that it expired."""
    pid = state(guarded, HEALTH)["pid"]
    guarded.shell().begin(f"kill -STOP {pid}")
    begin = time.monotonic()
    guarded.wait_for_event("WATCHDOG")
    took = time.monotonic() - begin
    guarded.reset()
    record_property("seconds_until_reset", round(took, 1))
    assert TIMEOUT - 2 < took < TIMEOUT + 1
    health = guarded.shell().run("ddxctl health")[1]
    assert "! last boot  the watchdog had reset the machine" in health
