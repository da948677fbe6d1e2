# SPDX-License-Identifier: GPL-2.0-or-later
"""All services of the image die repeatedly, or hang, at the same time, and the store separately: they are restarted
with pauses or replaced, which is counted and reported. tests/boot/test_each_service.py does it one by one in the
emulated machine, where no other service may be affected."""
from __future__ import annotations

import pathlib
import time
from collections.abc import Iterator

import pytest

from lib import calibration, crash_loop
from parts.guest.native_machine import NativeMachine
from parts.image import tables
from parts.media import clip, counters

from .programs import wait_until

pytestmark = pytest.mark.retry

SAVE, SEND = "ddxvideosave", "ddxvideosend"
SERVICES = tuple(tables.services())
OTHERS = tuple(name for name in SERVICES if name != "ddxstore")
SETTINGS = {"ddxvideoload": "loop=\n", SAVE: "segment=16\n", SEND: "interface=lo\n", "ddxdecode": "interface=lo\n",
            "ddxvideoSVS": "calib=/test/stereo.yml\n", "ddxcatalog": "c=/test/exports.conf\n"}


@pytest.fixture
def robot(root: pathlib.Path, tmp_path: pathlib.Path) -> Iterator[NativeMachine]:
    """A machine with all services running."""
    (tmp_path / "test").mkdir()
    clip.write(tmp_path / "test/clip.y4m", 1)
    (tmp_path / "test/stereo.yml").write_text(calibration.text(calibration.ideal(352, 144)))
    (tmp_path / "test/exports.conf").write_text("interface lo\n")
    for name in SERVICES:
        (tmp_path / f"test/{name}.conf").write_text("enabled=yes\n" + SETTINGS.get(name, ""))
    with NativeMachine(root, tmp_path) as machine:
        for name in SERVICES:
            machine.wait_until(f"ddxctl status {name} | grep -q state=running")
        yield machine


def counters_of(robot: NativeMachine, name: str) -> list[counters.Counters]:
    """The service's counters in the store, if any."""
    return counters.of(name, robot.run("ddxctl stats --json")[1])


def frames(robot: NativeMachine, name: str) -> int:
    """The number of frames that it put out."""
    return sum(one.out for one in counters_of(robot, name))


def restarts(robot: NativeMachine) -> dict[str, int]:
    return {name: int(robot.sh(f"cat /run/service/{name}/restarts")) for name in SERVICES}


def logs(robot: NativeMachine, wanted: dict[str, int]) -> str:
    """Logs of ddxhealth and of the services with a wrong number of restarts."""
    wrong = [name for name, often in restarts(robot).items() if often != wanted[name]]
    return "".join(f"--- {name}\n{robot.sh(f'ddxctl logs {name}')}" for name in [*wrong, "ddxhealth"])


@pytest.mark.parametrize("names", [OTHERS, ("ddxstore",)], ids=["all-but-store", "store"])
def test_a_service_that_dies_repeatedly_is_delayed_and_reported(robot: NativeMachine, names: tuple[str, ...]) -> None:
    robot.sh(crash_loop.at_once(names))
    screen = robot.run("ddxctl health")[1]
    for name in names:
        pauses = crash_loop.pauses(robot.sh(crash_loop.times(name)))
        assert len(pauses) == len(crash_loop.PAUSES) and crash_loop.too_soon(pauses) == [], (name, pauses)
        assert f"! service    {name} had to be started again, {crash_loop.KILLS} times; ddxctl logs {name}" in screen
        assert "state=died" in robot.sh(crash_loop.status(name))
        robot.wait_until(f"ddxctl status {name} | grep -q state=running")
    for name in (SAVE, "ddxdecode"):
        before = frames(robot, name)
        wait_until(lambda: frames(robot, name) > before)
    wanted = {name: crash_loop.KILLS if name in names else 0 for name in SERVICES}
    assert restarts(robot) == wanted, logs(robot, wanted)


def test_services_that_hang_are_replaced_and_counted(robot: NativeMachine) -> None:
    """All except ddxhealth; the store separately, since it hides the others' signs of life."""
    hung = tuple(name for name in OTHERS if name not in ("ddxhealth", "ddxpanel"))  # see test_panel.py
    for names in (hung, ("ddxstore",)):
        for name in names:
            robot.wait_until(f"ddxctl stats --json | grep -q '\"instance\":\"{name}\"' || [ {name} = ddxstore ]")
        pids = {name: robot.sh(f"cat /run/service/{name}/supervise/pid") for name in names}
        begin = time.monotonic()
        robot.sh(f"pids='{' '.join(pids.values())}'; "
                 "kill -STOP $pids $(for pid in $pids; do pgrep -P $pid; done)")  # including the store's worker
        for name in names:
            robot.wait_until(f"ddxctl status {name} | grep -q 'state=running .*restarts=1$'")
        print(f"replaced within {time.monotonic() - begin:.1f} s: {' '.join(names)}")  # the goal is 10
        said = robot.sh("ddxctl logs ddxhealth")
        for name, pid in pids.items():
            assert f"{name}: no sign of life from process {pid}, killed" in said
    wanted = {name: int(name not in ("ddxhealth", "ddxpanel")) for name in SERVICES}
    assert restarts(robot) == wanted, logs(robot, wanted)


def test_a_worker_of_the_store_that_hangs_is_replaced(robot: NativeMachine) -> None:
    """The worker is replaced before any client gives up: no service stops, the store is not restarted, and no recorded
    frame is lost."""
    wait_until(lambda: frames(robot, SAVE) > 0)
    pid = robot.sh("cat /run/service/ddxstore/supervise/pid")
    worker = robot.sh(f"pgrep -P {pid}")
    robot.sh(f"kill -STOP {worker}; ddxctl list")
    assert robot.sh("cat /run/service/ddxstore/supervise/pid") == pid != robot.sh(f"pgrep -P {pid}") != worker
    for name in (SAVE, "ddxdecode"):
        before = frames(robot, name)
        wait_until(lambda: frames(robot, name) > before)
    wanted = dict.fromkeys(SERVICES, 0)
    assert restarts(robot) == wanted, logs(robot, wanted)
    assert [one.lost_total for one in counters_of(robot, SAVE)] == [0]
