# SPDX-License-Identifier: GPL-2.0-or-later
"""The panel is found by the machine's name, also after a change of addresses: a second machine on a cable asks."""
from __future__ import annotations

import os
import pathlib
import subprocess
import sys
from collections.abc import Iterator

import pytest

from parts.common import MORTAL, TOP, run, wait_until
from parts.guest import panel
from parts.guest.native_machine import NativeMachine
from parts.processes import kill

pytestmark = pytest.mark.retry

NAME = "ddxvideo"  # the machine's, without a line in ddx.txt
FIRST, SECOND, OTHER = "10.9.0.1", "10.9.0.7", "10.9.0.2"
MDNSD = "pidof mdnsd"


class Neighbour:
    """A machine at the other end of the robot's cable, which is not plugged in yet: only a network."""

    def __init__(self, robot: NativeMachine) -> None:
        self.process = subprocess.Popen([*MORTAL, "unshare", "--net", "sleep", "infinity"])
        own = os.readlink("/proc/self/ns/net")
        wait_until(lambda: os.readlink(f"/proc/{self.process.pid}/ns/net") != own, "no network of its own")
        self.inside = ["nsenter", f"--net=/proc/{self.process.pid}/ns/net"]
        run(["ip", "link", "add", "eth0", "netns", str(robot.init), "type", "veth", "peer", "name", "eth0", "netns",
             str(self.process.pid)])
        self.run("ip", "addr", "add", f"{OTHER}/24", "dev", "eth0")
        self.run("ip", "link", "set", "eth0", "up")

    def run(self, *words: str) -> str:
        return run([*MORTAL, *self.inside, *words])

    def ask(self, name: str, kind: str) -> list[str]:
        return self.run(sys.executable, "-B", str(TOP / "tests/lib/mdns.py"), OTHER, name, kind).split()


@pytest.fixture
def robot(root: pathlib.Path, tmp_path: pathlib.Path) -> Iterator[NativeMachine]:
    with NativeMachine(root, tmp_path / "machine") as machine:
        yield machine


@pytest.fixture
def neighbour(robot: NativeMachine) -> Iterator[Neighbour]:
    one = Neighbour(robot)
    yield one
    kill(one.process)


def test_the_machine_is_found_by_its_name(robot: NativeMachine, neighbour: Neighbour) -> None:
    panel.start(robot)
    assert robot.run(MDNSD)[0] != 0 and robot.run("cat /dev/console")[0] != 0  # no network, nothing to announce
    robot.sh("ip link set eth0 up")
    robot.wait_until(MDNSD)  # with an address for this cable only (fe80::...), and no record for another kind
    before = robot.sh(MDNSD)
    robot.sh(f"ip addr add {FIRST}/24 dev eth0")
    assert neighbour.ask(f"{NAME}.local", "A") == [FIRST]
    assert robot.sh(MDNSD) != before
    assert neighbour.ask("_https._tcp.local", "PTR") == [f"{NAME}._https._tcp.local"]
    assert neighbour.ask(f"{NAME}._https._tcp.local", "SRV") == [f"{NAME}.local:443"]
    certificate = f"certificate, SHA-256: {panel.digest(panel.certificate(robot))}"
    places = [f"https://{FIRST}/", f"https://{NAME}.local/"]
    assert robot.sh("ddxctl panel").splitlines() == [*places, certificate]
    shown = [f"DDXVIDEO: panel: {line}" for line in (*places, certificate)]
    robot.wait_until(f"grep -q {FIRST} /dev/console")  # a file, since the machine has no screen
    assert robot.sh("cat /dev/console").splitlines() == shown

    # Another address, and another process, with as few rights as the web server.
    before = robot.sh(MDNSD)
    robot.sh(f"ip addr del {FIRST}/24 dev eth0; ip addr add {SECOND}/24 dev eth0")
    robot.wait_until(f"[ $({MDNSD}) != {before} ]")
    assert neighbour.ask(f"{NAME}.local", "A") == [SECOND]
    robot.wait_until(f"grep -q {SECOND} /dev/console")
    lines = robot.sh("cat /dev/console").splitlines()
    assert len([line for line in lines if SECOND in line]) == 1 and lines[-1] == shown[-1]
    process = robot.sh(MDNSD)
    fields = "/Uid|Gid|Groups|CapPrm|CapBnd|NoNewPrivs/"
    said = robot.sh(f"awk '{fields} {{ $1 = \"\"; printf \"%s,\", $2 }}' /proc/{process}/status").split(",")
    assert said[:3] == ["917", "65534", ""] and int(said[3], 16) == 0 and said[5] == "1"
    for folder in ("rec", "data", "run/ddx"):
        assert robot.sh(f"ls -A /{folder}") and not robot.sh(f"ls -A /proc/{process}/root/{folder}"), folder

    # Any machine may send what mdnsd does not survive: the panel goes on, and the name is back.
    robot.sh(f"kill -9 {process}")
    robot.wait_until(f"{MDNSD} && [ $({MDNSD}) != {process} ]")
    assert neighbour.ask(f"{NAME}.local", "A") == [SECOND]
    assert "restarts=0" in robot.sh("ddxctl status ddxpanel")
    assert "mdnsd has exited; it is started again in 1 s" in robot.sh("ddxctl logs ddxpanel")
    assert len(robot.sh("cat /dev/console").splitlines()) == len(lines)  # that is no change of addresses

    robot.sh("ddxctl disable ddxpanel")
    robot.wait_until(f"! {MDNSD}")


def test_an_open_console_shows_no_addresses(robot: NativeMachine, neighbour: Neighbour) -> None:
    """There may be a shell."""
    robot.sh("echo console=open >> /run/provision")
    panel.start(robot)
    robot.sh(f"ip link set eth0 up; ip addr add {FIRST}/24 dev eth0")
    assert neighbour.ask(f"{NAME}.local", "A") == [FIRST]
    # The program that shows has exited, so it has shown nothing.
    robot.wait_until("! pgrep panel-console")
    assert robot.run("cat /dev/console")[0] != 0
