#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""Numbered UDP packets: udp_peer.py send ADDRESS PORT COUNT SIZE [SECONDS], udp_peer.py receive PORT [GROUP]

send: evenly over that time, by default as fast as a receiver can read. receive: prints `ready`, and when standard input
is closed, the received numbers, the delay of each packet, and the sizes of packets that are not as sent, as JSON.
"""
import contextlib
import json
import select
import socket
import struct
import sys
import time
import zlib

SO_RCVBUFFORCE = 33  # missing in Python's module
BUFFER = 8 << 20
HURRY = 50e-6  # s per packet


def send(address: str, port: int, count: int, size: int, seconds: float) -> None:
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    begin = time.monotonic()
    with socket.socket(family, socket.SOCK_DGRAM) as one:
        for number in range(count):
            packet = struct.pack("!Iq", number, time.monotonic_ns()).ljust(size - 4, b".")
            one.sendto(packet + struct.pack("!I", zlib.crc32(packet)), (address, port))
            if (early := begin + (number + 1) * seconds / count - time.monotonic()) > 1e-3:
                time.sleep(early)


def receive(port: int, group: str) -> dict[str, list[int]]:
    found: dict[str, list[int]] = {"numbers": [], "transit_ns": [], "changed": []}
    with socket.socket(socket.AF_INET6, socket.SOCK_DGRAM) as one:  # also receives IPv4
        with contextlib.suppress(PermissionError):
            one.setsockopt(socket.SOL_SOCKET, SO_RCVBUFFORCE, BUFFER)
        one.bind(("::", port))
        if group:
            member = struct.pack("4s4s", socket.inet_aton(group), bytes(4))
            one.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
        print("ready", flush=True)
        while one in select.select([one, sys.stdin], [], [])[0]:
            packet = one.recv(65536)
            if len(packet) < 16 or struct.pack("!I", zlib.crc32(packet[:-4])) != packet[-4:]:
                found["changed"].append(len(packet))
                continue
            number, sent = struct.unpack_from("!Iq", packet)
            found["numbers"].append(number)
            found["transit_ns"].append(time.monotonic_ns() - sent)
    return found


def main() -> None:
    if sys.argv[1] == "send":
        count = int(sys.argv[4])
        send(sys.argv[2], int(sys.argv[3]), count, int(sys.argv[5]),
             float(sys.argv[6]) if len(sys.argv) > 6 else count * HURRY)
    else:
        print(json.dumps(receive(int(sys.argv[2]), sys.argv[3] if len(sys.argv) > 3 else "")))


if __name__ == "__main__":
    main()
