#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""A bad link between two ports of one machine: relay.py FROM TO SEED FAULT=PERCENT ...  (UDP ports of 127.0.0.1)

The faults are those of parts.link.faults. `copy=FILE` saves received packets. At first every packet passes. USR1
switches the faults on and prints `bad`; the next USR1 switches them off and prints `good` once all held packets are
sent. TERM prints the counts as JSON. Reports from TO go back to the sender.
"""
from __future__ import annotations

import contextlib
import json
import random
import signal
import socket
import sys
import time
from types import FrameType

from parts.link import loss
from parts.link.faults import Faults


class Relay:
    def __init__(self, source: int, target: int, seed: str, words: list[str]) -> None:
        self.inlet = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.inlet.bind(("127.0.0.1", source))
        self.target = ("127.0.0.1", target)
        self.sender: tuple[str, int] | None = None
        options = dict(word.split("=", 1) for word in words)
        self.copy = open(options.pop("copy"), "wb") if "copy" in options else None
        self.bad = {name: loss.Iid(float(value) / 100).judge(random.Random(f"{seed} {name}"))
                    for name, value in options.items()}
        self.faults = Faults(random.Random(seed))
        self.came = 0
        self.is_bad = self.ended = False
        self.said = "good"

    def send(self, packets: list[bytes]) -> None:
        for packet in packets:
            self.inlet.sendto(packet, self.target)

    def receive(self) -> None:
        packet, source = self.inlet.recvfrom(65536)
        if source != self.target:
            self.sender = source
            self.came += 1
            if self.copy:
                self.copy.write(len(packet).to_bytes(4, "big") + packet)
            _, own, added = self.faults.take(packet, time.monotonic())
            self.send(own + added)
        elif self.sender:
            self.inlet.sendto(packet, self.sender)

    def run(self) -> None:
        idle = False
        while not (self.ended and idle) or self.faults.held:  # packets received before TERM are sent
            self.inlet.settimeout(0.002 if self.faults.held or self.ended else 0.05)
            try:
                self.receive()
                idle = False
            except TimeoutError:
                idle = True
            if (self.said == "bad") != self.is_bad:
                self.said = "bad" if self.is_bad else "good"
                self.faults.turn(self.bad if self.is_bad else {})
                self.send(self.faults.due(time.monotonic()))
                print(self.said, flush=True)
            self.send(self.faults.due(time.monotonic()))
        print(json.dumps({"came": self.came, **self.faults.did}), flush=True)


def main() -> None:
    relay = Relay(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3], sys.argv[4:])

    def turn(_number: int, _frame: FrameType | None) -> None:
        relay.is_bad = not relay.is_bad

    def end(_number: int, _frame: FrameType | None) -> None:
        relay.ended = True

    signal.signal(signal.SIGUSR1, turn)
    signal.signal(signal.SIGTERM, end)
    print("ready", flush=True)
    with relay.copy or contextlib.nullcontext():
        relay.run()


if __name__ == "__main__":
    main()
