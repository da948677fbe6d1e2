# SPDX-License-Identifier: GPL-2.0-or-later
"""Multicast DNS (RFC 6762): questions, and what an answer says. As a program: ask on a network until an answer comes.

mdns.py ADDRESS NAME KIND   ask from the interface with this address for records of that kind (A, AAAA, PTR, SRV) of a
name, and print the data of each, a line each; nothing after PATIENCE seconds without an answer.
"""
import socket
import struct
import sys
import time

GROUP, PORT = "224.0.0.251", 5353
KINDS = {"A": 1, "PTR": 12, "TXT": 16, "AAAA": 28, "SRV": 33}
PATIENCE = 60.0  # s; mdnsd first makes sure, for a second, that no other machine has the name
ANSWER = 0x8000


def _name(packet: bytes, at: int) -> tuple[str, int]:
    """The name at this place, and the place after it. A length from 192 on is a pointer to the rest."""
    parts, after = [], 0
    while length := packet[at]:
        if length >= 192:
            after = after or at + 2
            at = struct.unpack_from("!H", packet, at)[0] & 0x3FFF
        else:
            parts.append(packet[at + 1:at + 1 + length].decode())
            at += 1 + length
    return ".".join(parts), after or at + 1


def question(name: str, kind: str) -> bytes:
    labels = b"".join(bytes([len(part)]) + part.encode() for part in name.split("."))
    return struct.pack("!6H", 0, 0, 1, 0, 0, 0) + labels + b"\0" + struct.pack("!HH", KINDS[kind], 1)


def records(packet: bytes) -> dict[tuple[str, str], list[str]]:
    """The data of each record by name and kind; nothing if it is no answer."""
    _, flags, questions, *counts = struct.unpack_from("!6H", packet)
    found: dict[tuple[str, str], list[str]] = {}
    at = 12
    if not flags & ANSWER:
        return found
    for _ in range(questions):
        at = _name(packet, at)[1] + 4
    for _ in range(sum(counts)):
        name, at = _name(packet, at)
        number, _, _, size = struct.unpack_from("!HHIH", packet, at)
        at += 10
        data = packet[at:at + size].hex()
        if number == KINDS["A"]:
            data = socket.inet_ntop(socket.AF_INET, packet[at:at + size])
        elif number == KINDS["AAAA"]:
            data = socket.inet_ntop(socket.AF_INET6, packet[at:at + size])
        elif number == KINDS["PTR"]:
            data = _name(packet, at)[0]
        elif number == KINDS["SRV"]:
            data = f"{_name(packet, at + 6)[0]}:{struct.unpack_from('!H', packet, at + 4)[0]}"
        kind = next((one for one, own in KINDS.items() if own == number), str(number))
        found.setdefault((name, kind), []).append(data)
        at += size
    return found


def ask(address: str, name: str, kind: str) -> list[str]:
    own = socket.inet_aton(address)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        link.bind(("", PORT))
        link.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, socket.inet_aton(GROUP) + own)
        link.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, own)
        link.settimeout(1)
        deadline = time.monotonic() + PATIENCE
        while time.monotonic() < deadline:
            link.sendto(question(name, kind), (GROUP, PORT))
            try:
                while time.monotonic() < deadline:
                    if data := records(link.recv(9000)).get((name, kind)):
                        return data
            except TimeoutError:
                pass
    return []


if __name__ == "__main__":
    print("\n".join(ask(*sys.argv[1:])))
