#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""A bad network between sender and receiver: relay.py FROM TO SEED FAULT=PERCENT ...  (UDP ports of 127.0.0.1)

FAULT: drop, duplicate, reorder (up to three later packets overtake), delay (200 ms), damage (a changed byte), foreign
(an H.264 packet of another source, or another payload type), garbage (no RTP). `copy=FILE` saves received packets.

At first every packet passes. USR1 switches the faults on and prints `bad`; the next USR1 switches them off and prints
`good` once all delayed packets are sent. TERM prints the counts as JSON. Reports from TO go back to the sender.
"""
from __future__ import annotations

import json
import random
import signal
import socket
import sys
import time
from types import FrameType

HOLD = 0.005  # s; longest wait of a reordered packet
LATE = 0.2


class Relay:
    def __init__(self, source: int, target: int, seed: str, words: list[str]) -> None:
        self.inlet = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.inlet.bind(("127.0.0.1", source))
        self.target = ("127.0.0.1", target)
        self.sender: tuple[str, int] | None = None
        self.random = random.Random(seed)
        self.percent = dict.fromkeys(["drop", "duplicate", "reorder", "delay", "damage", "foreign", "garbage"], 0.0)
        self.copy = None
        for word in words:
            name, value = word.split("=", 1)
            if name == "copy":
                self.copy = open(value, "wb")
            else:
                self.percent[name] = float(value)
        self.did = {name: 0 for name in ["came", *self.percent]}
        self.held: list[tuple[float, int, bytes]] = []  # time to send, packets that may still overtake, packet
        self.quiet, self.ended = True, False
        self.said = "good"

    def chance(self, name: str) -> bool:
        if self.quiet or self.random.uniform(0, 100) >= self.percent[name]:
            return False
        self.did[name] += 1
        return True

    def go(self, packet: bytes) -> None:
        self.inlet.sendto(packet, self.target)

    def stranger(self) -> bytes:
        """A packet of another stream: an unknown source or payload type."""
        number = self.random.getrandbits(16)
        if self.random.random() < 0.5:
            head = bytes([0x80, 96]) + number.to_bytes(2, "big")
        else:
            head = bytes([0x80, 33]) + number.to_bytes(2, "big")
        return head + self.random.randbytes(8) + self.random.randbytes(self.random.randint(1, 1000))

    def rubbish(self) -> bytes:
        """A packet of any length that is not RTP version 2, or is too short for RTP."""
        if self.random.random() < 0.3:
            return b"\x80" + self.random.randbytes(self.random.randint(0, 10))
        return bytes([self.random.getrandbits(7)]) + self.random.randbytes(self.random.randint(0, 1400))

    def damaged(self, packet: bytes) -> bytes:
        at = self.random.randrange(len(packet))
        return packet[:at] + bytes([packet[at] ^ self.random.randint(1, 255)]) + packet[at + 1:]

    def receive(self) -> None:
        packet, source = self.inlet.recvfrom(65536)
        if source != self.target:
            self.sender = source
            self.handle(packet)
        elif self.sender:
            self.inlet.sendto(packet, self.sender)

    def handle(self, packet: bytes) -> None:
        self.did["came"] += 1
        if self.copy:
            self.copy.write(len(packet).to_bytes(4, "big") + packet)
        now = time.monotonic()
        if self.chance("drop"):
            pass
        elif self.chance("delay"):
            self.held.append((now + LATE, 1 << 30, packet))
        elif self.chance("damage"):
            self.go(self.damaged(packet))
        elif self.chance("reorder"):
            self.held.append((now + HOLD, self.random.randint(1, 3), packet))
            return
        else:
            self.go(packet)
            if self.chance("duplicate"):
                self.go(packet)
        if self.chance("foreign"):
            self.go(self.stranger())
        if self.chance("garbage"):
            self.go(self.rubbish())
        self.held = [(when, rest - 1, held) for when, rest, held in self.held]

    def release(self) -> None:
        now = time.monotonic()
        for one in list(self.held):
            if self.quiet or one[0] <= now or one[1] <= 0:
                self.go(one[2])
                self.held.remove(one)

    def run(self) -> None:
        idle = False
        while not (self.ended and idle):  # packets received before TERM are sent
            self.inlet.settimeout(0.002 if self.held or self.ended else 0.05)
            try:
                self.receive()
                idle = False
            except TimeoutError:
                idle = True
            self.release()
            if self.said != (now := "good" if self.quiet else "bad"):
                self.said = now
                print(now, flush=True)
        print(json.dumps(self.did), flush=True)


def main() -> None:
    relay = Relay(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3], sys.argv[4:])

    def turn(_number: int, _frame: FrameType | None) -> None:
        relay.quiet = not relay.quiet

    def end(_number: int, _frame: FrameType | None) -> None:
        relay.ended = True

    signal.signal(signal.SIGUSR1, turn)
    signal.signal(signal.SIGTERM, end)
    print("ready", flush=True)
    relay.run()
    if relay.copy:
        relay.copy.close()


if __name__ == "__main__":
    main()
