# SPDX-License-Identifier: GPL-2.0-or-later
"""Faults of a bad link: it drops, delays, damages, reorders or doubles packets, and adds packets of others.

Each fault has a judge of loss.py. A packet suffers at most one fault: the judges are asked in the order of FAULTS,
until one agrees. Those of ADDED are asked after each packet.
"""
import random
import time
from collections.abc import Callable, Mapping

from parts.link import loss

FAULTS = ("drop", "delay", "damage", "reorder", "duplicate")
LATE = 0.2  # s that `delay` holds a packet
HOLD = 0.005  # s that `reorder` holds a packet at most,
OVERTAKE = 3  # and packets that overtake it at most


def foreign(generator: random.Random) -> bytes:
    """RTP of another source, or with another payload type."""
    kind = generator.choice([96, 33])
    return bytes([0x80, kind]) + generator.randbytes(10) + generator.randbytes(generator.randint(1, 1000))


def garbage(generator: random.Random) -> bytes:
    """Not RTP version 2, or too short for RTP."""
    if generator.random() < 0.3:
        return b"\x80" + generator.randbytes(generator.randint(0, 10))
    return bytes([generator.getrandbits(7)]) + generator.randbytes(generator.randint(0, 1400))


ADDED = {"foreign": foreign, "garbage": garbage}


class Faults:
    """The faults of one direction. `payload`: where the payload of a packet begins; None: such a packet is not changed,
    and none is added after it. `mend` corrects lengths and checksums of a packet with another payload."""

    def __init__(self, generator: random.Random, payload: Callable[[bytes], int | None] = lambda _: 0,
                 mend: Callable[[bytes], bytes] = lambda packet: packet) -> None:
        self.generator, self.payload, self.mend = generator, payload, mend
        self.did = dict.fromkeys([*FAULTS, *ADDED], 0)
        self.held: list[tuple[float, int, bytes]] = []  # time to send, packets that may still overtake, packet
        self.turn({})

    def turn(self, judges: Mapping[str, loss.Judge]) -> None:
        """Change the faults, from the next packet on. Held packets are due at once."""
        self.judges, self.begin = dict(judges), time.monotonic()
        self.faults = [name for name in FAULTS if name in judges]
        self.added = [name for name in ADDED if name in judges]
        self.held = [(0, rest, packet) for _, rest, packet in self.held]

    def _strikes(self, name: str, now: float) -> bool:
        struck = self.judges[name](now - self.begin)
        self.did[name] += struck
        return struck

    def _damaged(self, packet: bytes) -> bytes:
        start = self.payload(packet)
        assert start is not None
        at = self.generator.randrange(start, len(packet))
        return self.mend(packet[:at] + bytes([packet[at] ^ self.generator.randint(1, 255)]) + packet[at + 1:])

    def take(self, packet: bytes, now: float) -> tuple[str, list[bytes], list[bytes]]:
        """The fault that a packet suffers ("": none), the packets to deliver now, and those of others."""
        fault, own = "", [packet]
        for name in self.faults:
            if self._can(name, packet) and self._strikes(name, now):
                fault = name
                own = [packet, packet] if name == "duplicate" else [self._damaged(packet)] if name == "damage" else []
                break
        if self.held:
            self.held = [(due, rest - 1, one) for due, rest, one in self.held]
            own += self._released(lambda _, rest: rest <= 0)
        if fault == "delay":
            self.held.append((now + LATE, 1 << 30, packet))
        elif fault == "reorder":
            self.held.append((now + HOLD, self.generator.randint(1, OVERTAKE), packet))
        return fault, own, self._others(packet, now) if self.added else []

    def _others(self, packet: bytes, now: float) -> list[bytes]:
        start = self.payload(packet)
        return [self.mend(packet[:start] + ADDED[name](self.generator)) for name in self.added
                if start is not None and self._strikes(name, now)]

    def _can(self, fault: str, packet: bytes) -> bool:
        return fault != "damage" or self.payload(packet) not in (None, len(packet))

    def _released(self, is_due: Callable[[float, int], bool]) -> list[bytes]:
        found = [packet for due, rest, packet in self.held if is_due(due, rest)]
        self.held = [one for one in self.held if not is_due(one[0], one[1])]
        return found

    def due(self, now: float) -> list[bytes]:
        """Packets that were held until now."""
        return self._released(lambda due, _: due <= now) if self.held else []

    def wait(self, now: float) -> float | None:
        """Seconds until due() has a packet; None: none is held."""
        return max(0, min(due for due, _, _ in self.held) - now) if self.held else None
