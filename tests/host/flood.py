#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""Garbage for the ports of a stream: flood.py SSRC COUNT RATE ADDRESS PORT=KIND...

Sends COUNT datagrams, at most RATE a second, to the ports in turn. SSRC is the media stream's, in hex. Kinds: the
functions `media`, `repair` and `reports`. Prints the number sent to each port, as JSON.
"""
from __future__ import annotations

import json
import random
import socket
import struct
import sys
import time
from collections.abc import Callable

BURST = 20    # datagrams between checks of the clock
MADE = 4000   # different datagrams of each kind, sent in a loop
SOCKETS = 16  # more addresses than the sender accepts
LARGEST = 1400
H264, MPEG4, REPAIR, FEEDBACK = 96, 97, 98, 206
PLI, STATE = 1, 15  # formats of feedback
Maker = Callable[[random.Random, int], bytes]


def noise(source: random.Random, _: int) -> bytes:
    return source.randbytes(source.randint(0, LARGEST))


def media(source: random.Random, ssrc: int) -> bytes:
    """RTP of other streams, encrypted or not, of other payload types, truncated, or with impossible lengths."""
    own = source.random() < 0.2
    first = 0x80 | source.choice([0, 0x10, 0x10, 0x20, 0x0f])
    kind = source.choice([0, 33, 98, 127] if own else [H264, H264, MPEG4, MPEG4, 33])
    head = struct.pack(">BBHII", first, kind | source.choice([0, 0x80]), source.randrange(1 << 16),
                       source.randrange(1 << 32), ssrc if own else source.randrange(1 << 32))
    extension = struct.pack(">HHBHB", 0xbede, source.choice([1, 1, 6, 0xffff]), 0x22, source.randrange(1 << 16),
                            source.randrange(256)) if first & 0x10 else b""
    return (head + extension + noise(source, 0))[:source.choice([11, LARGEST, LARGEST, LARGEST])]


def repair(source: random.Random, ssrc: int) -> bytes:
    """Repair packets of this stream with an impossible window or density, and of other streams."""
    own = source.random() < 0.7
    shape = source.choice([0xf000, 0xf101, 0xffff, 0x0001, 0xe010]) if own else 0xf000 | source.randint(1, 256)
    head = struct.pack(">BBHII", 0x81, REPAIR, source.randrange(1 << 16), source.randrange(1 << 32),
                       source.randrange(1 << 32))
    window = struct.pack(">IHHI", ssrc if own else source.randrange(1 << 32), source.randrange(1 << 16), shape,
                         source.randrange(1 << 32))
    return head + window + noise(source, 0)


def reports(source: random.Random, ssrc: int) -> bytes:
    """Reports of many receivers of this stream with arbitrary losses; requests for a new picture; other RTCP."""
    head = struct.pack(">II", source.randrange(1 << 32), ssrc if source.random() < 0.9 else source.randrange(1 << 32))
    if source.random() < 0.2:
        return bytes([0x80 | PLI, FEEDBACK, 0, 2]) + head
    if source.random() < 0.2:
        return bytes([0x80 | source.randrange(32), source.randint(192, 223), 0, source.randrange(12)]) + head
    highest, missing = source.randrange(1 << 16), source.choice([0, 1, 100, 256, 0xffff])
    base = (highest - source.choice([0, 100, 255, 300, 0x7fff])) & 0xffff
    state = struct.pack(">4sHHHBBHHI", b"DDX1", highest, base, missing, source.randrange(256), source.randrange(256),
                        source.randrange(1 << 16), source.choice([0, 10, 0xffff]), source.randrange(1 << 32))
    return bytes([0x80 | STATE, FEEDBACK, 0, 7]) + head + state


MAKERS: dict[str, Maker] = {"media": media, "repair": repair, "reports": reports}


def made(kind: str, ssrc: int) -> list[bytes]:
    """The datagrams of a kind, and as much noise."""
    source = random.Random(kind)
    return [(noise if number % 2 else MAKERS[kind])(source, ssrc) for number in range(MADE)]


def main() -> None:
    ssrc, count, rate, address = int(sys.argv[1], 16), int(sys.argv[2]), int(sys.argv[3]), sys.argv[4]
    ports = {int(port): made(kind, ssrc) for port, kind in (word.split("=") for word in sys.argv[5:])}
    targets, sent = list(ports), dict.fromkeys(ports, 0)
    sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(SOCKETS)]
    due = time.monotonic()
    for number in range(count):
        port = targets[number % len(targets)]
        sockets[number // len(targets) % SOCKETS].sendto(ports[port][sent[port] % MADE], (address, port))
        sent[port] += 1
        if number % BURST == BURST - 1:
            due = max(due + BURST / rate, time.monotonic() - BURST / rate)  # do not catch up when late
            time.sleep(max(0, due - time.monotonic()))
    print(json.dumps(sent))


if __name__ == "__main__":
    main()
