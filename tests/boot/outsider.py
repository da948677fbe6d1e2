# SPDX-License-Identifier: GPL-2.0-or-later
"""The other end of a guest's network cable: sends chosen frames and receives all frames."""
from __future__ import annotations

import pathlib
import socket
import struct
import time

MAC, GUEST_MAC = bytes.fromhex("525400000002"), bytes.fromhex("525400000001")
IPV4, GUEST_IPV4 = socket.inet_aton("10.0.0.2"), socket.inet_aton("10.0.0.1")
IPV6 = socket.inet_pton(socket.AF_INET6, "fe80::2")
ALL_NODES = socket.inet_pton(socket.AF_INET6, "ff02::1")
ARP, IP4, IP6 = 0x0806, 0x0800, 0x86DD
ICMP, TCP, UDP, ICMP6 = 1, 6, 17, 58
ECHO6, SOLICITATION, ADVERTISEMENT = 128, 135, 136


def _sum(data: bytes) -> int:
    even = data + b"\0" * (len(data) % 2)
    total: int = sum(struct.unpack(f"!{len(even) // 2}H", even))
    while total >> 16:
        total = (total & 0xFFFF) + (total >> 16)
    return ~total & 0xFFFF


def ethernet(target: bytes, kind: int, content: bytes) -> bytes:
    return target + MAC + struct.pack("!H", kind) + content


def ip(source: bytes, target: bytes, protocol: int, content: bytes) -> bytes:
    """An IP packet around `content`, whose own checksum is filled in."""
    if len(target) == 4:
        pseudo = source + target + struct.pack("!HH", protocol, len(content)) if protocol != ICMP else b""
    else:
        pseudo = source + target + struct.pack("!II", len(content), protocol)
    at = {ICMP: 2, TCP: 16, UDP: 6, ICMP6: 2}[protocol]
    content = content[:at] + struct.pack("!H", _sum(pseudo + content) or 0xFFFF) + content[at + 2:]
    if len(target) == 4:
        header = struct.pack("!BBHHHBBH", 0x45, 0, 20 + len(content), 0, 0, 64, protocol, 0) + source + target
        return header[:10] + struct.pack("!H", _sum(header)) + header[12:] + content
    return struct.pack("!IHBB", 6 << 28, len(content), protocol, 255) + source + target + content


class Outsider:
    """`folder` holds the sockets of the cable. `came`: received frames, without the guest's address requests."""

    def __init__(self, folder: pathlib.Path) -> None:
        self.folder = folder
        self.came: list[bytes] = []
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 8 << 20)
        self._socket.bind(str(folder / "outsider"))
        self._socket.settimeout(30)  # QEMU takes a frame only when the guest has room

    def card(self) -> tuple[str, ...]:
        """QEMU's options for the guest's card."""
        places = f"local.type=unix,local.path={self.folder}/guest,remote.type=unix,remote.path={self.folder}/outsider"
        return ("-netdev", f"dgram,id=net,{places}", "-device", "virtio-net-pci,netdev=net,mac=" + GUEST_MAC.hex(":"))

    def send(self, frame: bytes) -> None:
        self._socket.sendto(frame, str(self.folder / "guest"))

    def receive(self, seconds: float) -> list[bytes]:
        """Frames that arrive within that time; 0: those that are waiting. Answers requests for our address."""
        found = []
        deadline = time.monotonic() + seconds
        while True:
            left = deadline - time.monotonic()
            self._socket.settimeout(max(left, 0))
            try:
                frame = self._socket.recv(65536)
            except (BlockingIOError, TimeoutError):
                break
            finally:
                self._socket.settimeout(30)
            self.came.append(frame)
            if not self._answer(frame):
                found.append(frame)
        return found

    def _answer(self, frame: bytes) -> bool:
        """Answer an ARP or IPv6 neighbour request for our address."""
        if frame[12:22] == struct.pack("!HHHBBH", ARP, 1, IP4, 6, 4, 1) and frame[38:42] == IPV4:
            self.send(ethernet(frame[6:12], ARP, frame[14:20] + b"\0\2" + MAC + IPV4 + frame[22:32]))
            return True
        if frame[12:14] == b"\x86\xdd" and frame[20] == ICMP6 and frame[54] == SOLICITATION and frame[62:78] == IPV6:
            known = struct.pack("!BBHI", ADVERTISEMENT, 0, 0, 0x60000000) + IPV6 + b"\2\1" + MAC
            self.send(ethernet(frame[6:12], IP6, ip(IPV6, frame[22:38], ICMP6, known)))
            return True
        return False

    def ipv6_neighbour(self, seconds: float) -> bytes:
        """The address from which the guest answers a ping to all nodes; empty without an answer."""
        call = ip(IPV6, ALL_NODES, ICMP6, struct.pack("!BBHHH", ECHO6, 0, 0, 1, 1))
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            self.send(ethernet(b"\x33\x33\0\0\0\1", IP6, call))
            for frame in self.receive(1):
                if frame[12:14] == b"\x86\xdd" and frame[20] == ICMP6 and frame[54] == ECHO6 + 1:
                    return frame[22:38]
        return b""

    def end(self) -> None:
        self._socket.close()
