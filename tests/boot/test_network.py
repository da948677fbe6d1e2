# SPDX-License-Identifier: GPL-2.0-or-later
"""ddx.txt sets network, clock and services; wrong lines are reported; without it the network is off."""
import pathlib
import time

import pytest

from parts.guest import session, testdisk
from parts.guest.qemu import Boot, Guest
from parts.media import clip as default_clip

from . import camera
from .networked import WRONG, WRONG_LINE, Robot
from .segment import Segment
from .test_control import run, runs, services
from .test_privileges import unconfined

pytestmark = pytest.mark.retry


@pytest.fixture(scope="module")
def provisioned(robot: Robot) -> Guest:
    return robot.guest


def test_interfaces_are_as_provisioned(provisioned: Guest) -> None:
    provisioned.wait_until("ip -o addr show eth0 | grep -q 10.0.2.15/24")
    provisioned.wait_until("ip -o addr show eth1 | grep -q 192.168.7.2/24")
    assert provisioned.sh("hostname") == "robot1"
    provisioned.wait_until("grep -q 10.0.2.3 /etc/resolv.conf")
    assert "via 10.0.2.2 dev eth0" in provisioned.sh("ip route show default")
    assert provisioned.sh("cat /sys/class/net/eth2/flags") == "0x1002"  # down, because its line was wrong


def test_a_wrong_line_is_reported(provisioned: Guest) -> None:
    text = f"ddx.txt, line {WRONG_LINE}: {WRONG}: dhcp is needed, or an address"
    provisioned.wait_for_log(text.encode())
    status, screen = run(provisioned, "ddxctl health")
    assert status == 1 and f"! ddx.txt    line {WRONG_LINE}: " in screen


def test_an_interface_that_comes_back_is_set_up_again(provisioned: Guest) -> None:
    """Also when it is back before its supervisor saw that it was gone."""
    provisioned.sh("sv pause /run/service/network.eth1")
    provisioned.sh("echo 1 > /sys/class/net/eth1/device/../remove")
    provisioned.wait_until("! test -d /sys/class/net/eth1")
    provisioned.sh("echo 1 > /sys/bus/pci/rescan")
    provisioned.wait_until("test -d /sys/class/net/eth1")
    provisioned.sh("sv cont /run/service/network.eth1")
    provisioned.wait_until("ip -o addr show eth1 | grep -q 192.168.7.2/24")


def test_a_lease_is_renewed_when_the_cable_is_back(provisioned: Guest) -> None:
    asked = "grep -c 'renew' /run/log/network.eth0/current"
    before = int(provisioned.sh(f"{asked} || true"))
    for up in (False, True):
        provisioned.monitor("set_link", name="card0", up=up)
        provisioned.wait_until(f"grep -q {int(up)} /sys/class/net/eth0/carrier")
        time.sleep(3)  # the carrier is polled every 2 s
    provisioned.wait_until(f"test $({asked}) -gt {before}")


def test_services_are_as_provisioned_until_ddxctl_changes_them(provisioned: Guest) -> None:
    runs(provisioned, "ddxvideosend")
    assert services(provisioned)["ddxvideosave"]["enabled"] is False
    provisioned.sh("ddxctl enable ddxvideosave")
    runs(provisioned, "ddxvideosave")


def test_root_s_programs_have_only_the_capabilities_they_need(provisioned: Guest) -> None:
    provisioned.wait_until("pidof ntpd udhcpc | grep -q ' '")
    assert unconfined(provisioned) == ({"network", "udhcpc", "ntpd"}, [])


@pytest.mark.long
def test_network_time_sets_the_clock_and_loses_no_frame(boot: Boot, work: pathlib.Path, tmp_path: pathlib.Path,
                                                               clip: pathlib.Path) -> None:
    disk = testdisk.make(work / "ntp.img", clip)
    segment = Segment(tmp_path, "1")
    with boot("ntp-server", provision="network=eth0 10.0.0.2/24\n",
              extra=(*segment.card(1), "-rtc", "base=2031-05-06T12:00:00")) as server:
        server.sh("ntpd -l")
        with boot("ntp", provision="network=eth0 10.0.0.1/24\nntp=10.0.0.2\n", test_disk=disk,
                  extra=(*segment.card(0), "-rtc", "base=2026-03-01T12:00:00")) as guest:
            camera.wait_for_frames(guest, 25, session.LOAD)
            guest.wait_until('test "$(date -u +%Y)" = 2031')
            session.wait_for_clip(guest, default_clip.SECONDS * default_clip.RATE)
            session.stop_recorder(guest)
            result = session.collect(guest, clip, work / "ntp.y4m")
            said = guest.sh("cat /run/log/ntp/current")
    segment.end()
    assert result.good, result.disagreements
    assert "setting time" in said
