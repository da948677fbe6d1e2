# SPDX-License-Identifier: GPL-2.0-or-later
"""Ports open to the network: those in board/common/manifest.txt with all services on, otherwise none."""
import pathlib
import struct
import tempfile
from collections.abc import Iterator

import pytest

from lib import manifest
from parts.guest import session, testdisk
from parts.guest.qemu import Boot, Guest
from parts.media import clip as default_clip

from .outsider import ARP, GUEST_IPV4, GUEST_MAC, IP4, IPV4, MAC, TCP, Outsider, ethernet, ip
from .scan import ALL, SYN, listening
from .test_control import runs

pytestmark = [pytest.mark.retry, pytest.mark.long]

SECONDS = 4
KEY = "ssh-ed25519 AAAAC3NzaC1lZDI1NTE5AAAAIBkvAbcdAbcdAbcdAbcdAbcdAbcdAbcdAbcdAbcdAbcd someone@there"
ADDRESS = "10.0.0.1/24"
LOWER = range(1, 10000)
LOWEST = range(1, 2048)
# Linux limits "port unreachable" to a few a second; the scan needs one for each closed port.
TALKATIVE = "sysctl -w net.ipv4.icmp_ratelimit=0 net.ipv4.icmp_msgs_per_sec=1000000 net.ipv4.icmp_msgs_burst=10000 " \
            "net.ipv6.icmp.ratelimit=0"


@pytest.fixture
def outsider() -> Iterator[Outsider]:
    with tempfile.TemporaryDirectory(prefix="ddx-") as folder:
        one = Outsider(pathlib.Path(folder))
        yield one
        one.end()


def everywhere(guest: Guest, outsider: Outsider, ports: range = ALL) -> set[tuple[str, int]]:
    """The scan of both addresses: the given one, and IPv6's link-local one. There the lower ports are enough: only a
    user's service would listen on IPv6 alone."""
    guest.sh(TALKATIVE)
    neighbour = outsider.ipv6_neighbour(60)
    assert neighbour, "no answer over IPv6: is it on?"
    by_ipv6 = LOWER if ports == ALL else ports
    return listening(outsider, GUEST_IPV4, ports) | listening(outsider, neighbour, by_ipv6)


def call(outsider: Outsider) -> None:
    """Look for the guest with each protocol that discovers machines."""
    question = struct.pack("!HHBBH", 1, IP4, 6, 4, 1) + MAC + IPV4 + bytes(6) + GUEST_IPV4
    connect = struct.pack("!HHIIBBHHH", 40000, 22, 1000, 0, 5 << 4, SYN, 1024, 0, 0)
    outsider.send(ethernet(b"\xff" * 6, ARP, question))
    outsider.send(ethernet(GUEST_MAC, IP4, ip(IPV4, GUEST_IPV4, TCP, connect)))


def test_an_unprovisioned_image_is_silent_and_has_no_open_port(boot: Boot, outsider: Outsider) -> None:
    with boot("ports-none", extra=outsider.card()) as guest:
        guest.wait_until("test -d /sys/class/net/eth0")
        guest.sh("sleep 2")  # a program might react to the interface
        call(outsider)
        assert outsider.ipv6_neighbour(3) == b"" and outsider.came == []
        guest.sh(f"ip link set eth0 up && ip addr add {ADDRESS} dev eth0")  # as a user might do
        assert everywhere(guest, outsider, LOWEST) == set()  # the next test scans all ports
        assert len(outsider.came) > 3 * len(LOWEST)  # it did answer


def test_with_all_services_on_only_declared_ports_are_open(boot: Boot, work: pathlib.Path, outsider: Outsider) -> None:
    clip = default_clip.write(work / "ports.y4m", SECONDS)
    send = "enabled=yes\ncodec=mpeg4\ninterface=eth0\n"
    disk = testdisk.make(work / "ports.img", clip, {"ddxvideosend.conf": send, "ddxvideoload.conf": "readers=2\n"})
    provision = f"network=eth0 {ADDRESS}\nssh_key={KEY}\nservice=ddxdecode on\nservice=ddxcatalog on\n" \
                "panel=open-sesame-42\n"
    with boot("ports", provision=provision, test_disk=disk, extra=outsider.card()) as guest:
        session.wait_for_clip(guest, SECONDS * default_clip.RATE)
        guest.wait_until("netstat -tln | grep -q :22")
        runs(guest, "ddxdecode")
        runs(guest, "ddxvideosend")
        guest.wait_until("netstat -uln | grep -q :7411")
        guest.wait_until("ddxctl logs ddxpanel | grep -q ready")
        guest.wait_until("netstat -uln | grep -q :5353")
        found = everywhere(guest, outsider)
        stream = [frame for frame in outsider.came if frame[:3] == b"\x01\x00\x5e" and frame[36:38] == b"\x1f\x40"]
        assert len(stream) > 10  # the sender has sent
        assert manifest.ports({(kind, port, "") for kind, port in found}) == []

        # Proves that the scan finds further ports.
        guest.sh("dropbear -E -R -p 4444 -r /run/other-key 2> /dev/null; ntpd -l")
        assert everywhere(guest, outsider, LOWER) - found == {("tcp", 4444), ("udp", 123)}
