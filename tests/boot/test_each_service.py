# SPDX-License-Identifier: GPL-2.0-or-later
"""Each service in turn is killed, hangs, and dies repeatedly: it comes back, that is counted, frames flow again, and no
other service is affected. The durations are figures."""
import pathlib
from collections.abc import Iterator

import pytest

from lib import calibration, crash_loop
from lib.figures import Figure, uptime
from parts.guest import stream, testdisk
from parts.guest.qemu import Boot, Guest
from parts.guest.session import LOAD, SAVE
from parts.image import tables

from . import camera
from .test_control import runs, services
from .test_health import HEALTH, hang, state

pytestmark = [pytest.mark.retry, pytest.mark.long]

SERVICES = tables.services()
# The watchdog supervises the one (test_health.py), and the panel has no counters (tests/host/test_panel.py).
LOOKED_AFTER = [name for name in SERVICES if name not in (HEALTH, "ddxpanel")]
LONG_RUN = 11  # s; a service that ran this long is restarted at once
DISK = 8 << 30  # bytes; enough for all recordings of these tests
SETTINGS = {LOAD: "loop=\nrate=0.4\n", SAVE: "segment=16\n", stream.SEND: "interface=lo\ncodec=mpeg4\n",
            stream.DECODE: "interface=lo\n", "ddxvideoSVS": "calib=/test/stereo.yml\n",
            "ddxcatalog": "c=/test/exports.conf\n"}


@pytest.fixture(scope="module")
def guest(boot: Boot, work: pathlib.Path, clip: pathlib.Path) -> Iterator[Guest]:
    """A guest with all services: a clip plays in a loop, and is recorded and streamed."""
    files = {f"{name}.conf": "enabled=yes\n" + SETTINGS.get(name, "") for name in SERVICES}
    files["exports.conf"] = "interface lo\n"
    files["stereo.yml"] = calibration.text(calibration.ideal(352, 144))
    disk = testdisk.make(work / "each.img", clip, files)
    with boot("each-service", test_disk=disk, size=DISK) as running:
        running.shell()
        for name in SERVICES:
            runs(running, name)
        camera.wait_for_frames(running, 25, stream.DECODE)
        yield running


def restarts(guest: Guest) -> dict[str, object]:
    return {name: one["restarts"] for name, one in services(guest).items() if name in SERVICES}


def plus(before: dict[str, object], name: str, times: int = 1) -> dict[str, object]:
    """The restart counts `before`, plus `times` for one service."""
    return {**before, name: int(str(before[name])) + times}


def wait_until_frames_flow(guest: Guest) -> None:
    """Wait until new frames reach the end of the chain."""
    for name in (SAVE, stream.DECODE):
        camera.wait_for_frames(guest, 10, name)


@pytest.mark.parametrize("name", SERVICES)
def test_killed(guest: Guest, record_property: Figure, name: str) -> None:
    guest.sh(f"sleep {LONG_RUN}")
    before, pid = restarts(guest), state(guest, name)["pid"]
    supervise = f"/run/service/{name}/supervise/pid"
    begin = uptime(guest)
    guest.sh(f"kill -9 {pid}; until read -r now < {supervise} && [ $now != {pid} ]; do sleep 0.05; done")
    record_property("seconds_until_back", round(uptime(guest) - begin, 2))
    runs(guest, name)
    wait_until_frames_flow(guest)
    assert restarts(guest) == plus(before, name)


@pytest.mark.parametrize("signal", ["KILL", "STOP"])
def test_a_worker_of_the_store_is_replaced(guest: Guest, record_property: Figure, signal: str) -> None:
    """A new worker replaces a dead or hung one; no service stops, and no recorded frame is lost."""
    before, pid = restarts(guest), state(guest, "ddxstore")["pid"]
    worker, begin = guest.sh(f"pgrep -P {pid}").strip(), uptime(guest)
    guest.sh(f"(kill -{signal} {worker}; until now=$(pgrep -P {pid}) && [ $now != {worker} ]; "
             f"do kill -0 {pid} || exit 1; sleep 0.05; done)")
    record_property("seconds_until_replaced", round(uptime(guest) - begin, 2))
    wait_until_frames_flow(guest)
    assert restarts(guest) == before


@pytest.mark.parametrize("name", LOOKED_AFTER)
def test_hung(guest: Guest, record_property: Figure, name: str) -> None:
    before = restarts(guest)
    record_property("seconds_until_replaced", round(hang(guest, name), 1))
    wait_until_frames_flow(guest)
    assert restarts(guest) == plus(before, name)


@pytest.mark.parametrize("name", SERVICES)
def test_dies_repeatedly(guest: Guest, record_property: Figure, name: str) -> None:
    before = restarts(guest)
    guest.sh(crash_loop.at_once([name]))
    screen = guest.shell().run("ddxctl health")[1]
    pauses = crash_loop.pauses(guest.sh(crash_loop.times(name)))
    record_property("seconds_between", pauses)
    assert len(pauses) == len(crash_loop.PAUSES) and crash_loop.too_soon(pauses) == []
    assert "state=died" in guest.sh(crash_loop.status(name))
    after = plus(before, name, crash_loop.KILLS)
    assert f"! service    {name} had to be started again, {after[name]} times; ddxctl logs {name}" in screen
    runs(guest, name)
    wait_until_frames_flow(guest)
    assert restarts(guest) == after
