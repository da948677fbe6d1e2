# SPDX-License-Identifier: GPL-2.0-or-later
"""Wi-Fi as ddx.txt sets it, with two simulated radios, one of them an access point bridged to the wired card."""
import time
from collections.abc import Iterator

import pytest

from parts.common import PATIENCE
from parts.guest.qemu import Boot, Guest

from .test_control import run
from .test_privileges import ADDRESSES

pytestmark = [pytest.mark.retry, pytest.mark.long]

NAME, PHRASE, OTHER = "Robot Hall", 'correct "horse" = #1', "another one altogether"
PROVISION = f"""\
country=DE
wifi=Elsewhere "not in range, 1"
wifi="{NAME}" "{PHRASE.replace('"', '""')}"
network=wlan0 dhcp
"""
CARD = ("-netdev", "user,id=net,ipv6=off", "-device", "virtio-net-pci,netdev=net")


class AccessPoint:
    """The second radio, bridged to the wired card: a station that joins it gets a lease from there. The machine itself
    reaches the cable only through it."""

    def __init__(self, guest: Guest) -> None:
        self.guest = guest
        guest.sh("modprobe bridge && ip link add br0 type bridge && ip link set eth0 master br0 && "
                 "ip link set eth0 up && ip link set br0 up")
        guest.sh("sysctl -w net.ipv4.conf.all.arp_ignore=1")  # so that the bridge does not answer for wlan0's address

    def on(self, phrase: str) -> None:
        text = "\\n".join(["network={", f'ssid="{NAME}"', "mode=2", "frequency=2412", "key_mgmt=WPA-PSK", "proto=RSN",
                           "pairwise=CCMP", f'psk="{phrase}"', "}"])
        self.guest.sh(f"printf '{text}\\n' > /tmp/ap; rm -f /tmp/ap.log; "
                      "wpa_supplicant -B -i wlan1 -b br0 -D nl80211 -c /tmp/ap -f /tmp/ap.log -P /tmp/ap.pid")
        self.guest.wait_until("grep -q AP-ENABLED /tmp/ap.log")
        self.guest.sh("ip link set wlan1 master br0")

    def off(self) -> None:
        self.guest.sh("ip link set wlan1 nomaster; kill $(cat /tmp/ap.pid)")
        self.guest.wait_until("! test -e /tmp/ap.pid")


@pytest.fixture(scope="module")
def robot(boot: Boot) -> Iterator[Guest]:
    """The radios appear after the boot, like an adapter that is plugged in later."""
    with boot("wifi", provision=PROVISION, extra=CARD) as guest:
        guest.shell()
        assert "! network    wlan0: there is no such adapter" in run(guest, "ddxctl health")[1]
        guest.sh("modprobe mac80211_hwsim radios=2")
        yield guest


@pytest.fixture(scope="module")
def point(robot: Guest) -> AccessPoint:
    one = AccessPoint(robot)
    one.on(PHRASE)
    return one


def wait_until_joined(robot: Guest) -> None:
    """Wait until data arrives by radio."""
    robot.wait_until("ip -o addr show wlan0 | grep -q 10.0.2.15/24")
    robot.wait_until("ping -c 1 -W 2 10.0.2.2 > /dev/null")


def health_with(robot: Guest, text: str, seconds: float = PATIENCE) -> str:
    deadline = time.monotonic() + seconds
    while text not in (screen := run(robot, "ddxctl health")[1]) and time.monotonic() < deadline:
        time.sleep(1)
    assert text in screen
    return screen


def complaints(screen: str) -> set[str]:
    return {line[:12] for line in screen.splitlines() if line.startswith("!")}


def test_joins_a_network_and_gets_a_lease(robot: Guest, point: AccessPoint) -> None:
    wait_until_joined(robot)
    before = int(robot.sh("cat /sys/class/net/wlan0/statistics/rx_bytes"))
    robot.sh("ping -c 3 -s 1000 10.0.2.2")
    assert int(robot.sh("cat /sys/class/net/wlan0/statistics/rx_bytes")) > before + 3000
    _, screen = run(robot, "ddxctl health")
    assert f"  network    wlan0: up, 10.0.2.15/24, {NAME} at -" in screen, screen
    status = robot.sh("cat /proc/$(cat /run/service/wifi.wlan0/supervise/pid)/status")
    assert f"CapPrm:\t{ADDRESSES:016x}" in status and f"CapBnd:\t{ADDRESSES:016x}" in status


def test_the_passphrase_is_in_two_files_for_root_and_nowhere_else(robot: Guest, point: AccessPoint) -> None:
    search = "find /run /etc /data /tmp -type f ! -path /tmp/ap -exec grep -l 'correct \"*[h]orse' {} +"
    files = set(robot.sh(f"{search} || true").split())
    assert files == {"/run/provision", "/run/wifi/config"}
    assert set(robot.sh(f"stat -c %a {' '.join(files)}").split()) == {"600"}
    visible = robot.sh("cat /proc/[0-9]*/cmdline /proc/[0-9]*/environ | tr '\\0' ' '; dmesg; ddxctl health; true")
    assert "wpa_supplicant" in visible and "orse" not in visible
    assert b"orse" not in robot.log.read_bytes()


def test_an_access_point_that_comes_back_is_joined_again(robot: Guest, point: AccessPoint) -> None:
    wait_until_joined(robot)
    point.off()
    health_with(robot, "! network    wlan0: in no wireless network\n")
    assert run(robot, "ping -c 1 -W 2 10.0.2.2")[0] != 0  # there is no other path
    point.on(PHRASE)
    wait_until_joined(robot)


def test_a_wrong_passphrase_is_reported_and_harms_nothing_else(robot: Guest, point: AccessPoint) -> None:
    before = complaints(run(robot, "ddxctl health")[1])
    point.off()
    point.on(OTHER)
    screen = health_with(robot, f"! network    wlan0: in no wireless network; is the passphrase of {NAME} right?")
    assert "reason=WRONG_KEY" in robot.sh("cat /run/log/wifi.wlan0/current")
    assert complaints(screen) - before == {"! network   "}
    point.off()
    point.on(PHRASE)
    wait_until_joined(robot)
