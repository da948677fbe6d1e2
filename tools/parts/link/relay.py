# SPDX-License-Identifier: GPL-2.0-or-later
"""The relay process of a lossy link: makes the network namespaces and holds the other ends of their TAP devices.

python -m parts.link.relay OPERATORS DELAY_MS SEED [meet]. Prints its namespaces as file descriptors, the robot's
first; other processes open them as /proc/<pid>/fd/<number>. With `meet` it is a switch: all nodes see each other, and
nothing is lost. Each line of standard input is then an order in JSON, answered by a line:
{"turn": [[operator, direction, {fault: pattern}], ...]} or {"counts": true}. Exits when standard input is closed.
"""
import collections
import contextlib
import ctypes
import dataclasses
import fcntl
import json
import os
import random
import select
import struct
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator
from typing import Any

from parts.link import loss
from parts.link.faults import Faults

DEVICE, QUEUE = "link0", 10000  # packets that can wait for the relay, more than a test sends at once
TUNSETIFF, IFF_TAP, IFF_NO_PI = 0x400454CA, 2, 0x1000
CLONE_NEWNET = 0x40000000
ETHERNET, UDP = 14, 17
FRAME_MAX = 65536
BATCH = 64  # frames of one device before the next device's turn
HOST = "10.20.0."  # the robot is 1, operators 2 and above
SETUP = """\
link set lo up
link set {device} address {mac} txqueuelen {queue} multicast on up
address add {address}/24 dev {device}
address add fd20::{number}/64 dev {device} nodad
route add default dev {device}
"""
# Set before the first packet: packets that wait for an ARP answer would be sent out of order.
NEIGHBOUR = "neigh add {address} lladdr {mac} nud permanent dev {device}\n"
LIBC = ctypes.CDLL(None, use_errno=True)


def check(result: int, what: str) -> None:
    if result:
        raise OSError(ctypes.get_errno(), f"{what}: {os.strerror(ctypes.get_errno())}")


@contextlib.contextmanager
def inside(namespace: int) -> Iterator[None]:
    home = os.open("/proc/thread-self/ns/net", os.O_RDONLY)
    check(LIBC.setns(namespace, CLONE_NEWNET), "setns")
    try:
        yield
    finally:
        check(LIBC.setns(home, CLONE_NEWNET), "setns")
        os.close(home)


def mac(number: int) -> bytes:
    return bytes([2, 0, 0, 0, 0, number])


class Port:
    """A namespace and the relay's end of its TAP device."""

    def __init__(self, number: int, neighbours: Iterable[int]) -> None:
        check(LIBC.unshare(CLONE_NEWNET), "unshare")
        self.namespace = os.open("/proc/thread-self/ns/net", os.O_RDONLY)
        self.tap = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
        fcntl.ioctl(self.tap, TUNSETIFF, struct.pack("16sH22x", DEVICE.encode(), IFF_TAP | IFF_NO_PI))
        lines = SETUP.format(device=DEVICE, queue=QUEUE, mac=mac(number).hex(":"), number=number,
                             address=f"{HOST}{number}")
        for other in neighbours:
            lines += "".join(NEIGHBOUR.format(address=address, mac=mac(other).hex(":"), device=DEVICE)
                             for address in (f"{HOST}{other}", f"fd20::{other}"))
        subprocess.run(["ip", "-batch", "-"], input=lines, text=True, check=True)

    def overrun(self) -> int:
        """Packets that the device dropped because the relay was too slow."""
        with inside(self.namespace), open("/proc/thread-self/net/dev") as file:
            line = next(line for line in file if line.strip().startswith(DEVICE))
        return int(line.split(":")[1].split()[11])


@dataclasses.dataclass
class Flow:
    """UDP to one port. Bytes include the IP header."""
    packets: int = 0
    bytes: int = 0
    lost: int = 0
    delivered: int = 0
    delivered_bytes: int = 0
    doubled: int = 0  # packets that were sent on twice


def checksum(data: bytes) -> int:
    """RFC 1071."""
    total: int = sum(struct.unpack(f"!{(len(data) + 1) // 2}H", data + b"\0" * (len(data) % 2)))
    while total >> 16:
        total = (total & 0xFFFF) + (total >> 16)
    return 0xFFFF - total


def udp_start(frame: bytes) -> int | None:
    """Where the UDP header begins; None if the frame is not UDP, or is a later fragment."""
    kind = frame[12:ETHERNET]
    if kind == b"\x08\x00" and frame[ETHERNET + 9] == UDP:
        fragment = frame[ETHERNET + 6] & 0x1F or frame[ETHERNET + 7]
        return None if fragment else ETHERNET + 4 * (frame[ETHERNET] & 15)
    return ETHERNET + 40 if kind == b"\x86\xdd" and frame[ETHERNET + 6] == UDP else None


def udp_payload(frame: bytes) -> int | None:
    """Where the payload of a whole UDP packet begins."""
    start = udp_start(frame)
    more = frame[12:ETHERNET] == b"\x08\x00" and frame[ETHERNET + 6] & 0x20  # fragments follow
    return None if start is None or more else start + 8


def mended(frame: bytes) -> bytes:
    """A UDP packet whose payload was changed, with right lengths and checksums."""
    new, start = bytearray(frame), udp_start(frame)
    assert start is not None
    size = len(new) - start
    if start == ETHERNET + 40:
        struct.pack_into("!H", new, ETHERNET + 4, size)
        addresses = new[ETHERNET + 8:start]
    else:
        struct.pack_into("!H", new, ETHERNET + 2, len(new) - ETHERNET)
        struct.pack_into("!H", new, ETHERNET + 10, 0)
        struct.pack_into("!H", new, ETHERNET + 10, checksum(new[ETHERNET:start]))
        addresses = new[ETHERNET + 12:ETHERNET + 20]
    struct.pack_into("!HH", new, start + 4, size, 0)
    struct.pack_into("!H", new, start + 6,
                     checksum(addresses + struct.pack("!HH", UDP, size) + new[start:]) or 0xFFFF)
    return bytes(new)


def never(_: float) -> bool:
    return False


class Way:
    """One direction between two ends."""

    def __init__(self, target: int, seed: str = "") -> None:
        self.target = target
        self.faults = Faults(random.Random(seed), udp_payload, mended)
        self.flows: dict[int, Flow] = {}
        self.second: collections.deque[tuple[float, int]] = collections.deque()  # packets of the last second
        self.load = self.peak = 0  # bytes in that second, and the maximum

    def lose(self, judge: loss.Judge, double: loss.Judge = never) -> None:
        self.faults.turn({"drop": judge, "duplicate": double})

    def take(self, port: int, packet: bytes, size: int, now: float) -> tuple[list[bytes], list[bytes]]:
        """Count a packet. The packets to deliver now, and those of others."""
        flow = self.flows.setdefault(port, Flow())
        flow.packets += 1
        flow.bytes += size
        self.second.append((now, size))
        self.load += size
        while self.second[0][0] <= now - 1:
            self.load -= self.second.popleft()[1]
        self.peak = max(self.peak, self.load)
        fault, own, added = self.faults.take(packet, now)
        flow.lost += fault == "drop"
        flow.doubled += fault == "duplicate"
        return own, added

    def arrived(self, port: int, size: int) -> None:
        self.flows[port].delivered += 1
        self.flows[port].delivered_bytes += size

    def counts(self) -> dict[str, Any]:
        return {"peak": self.peak, "did": self.faults.did,
                "ports": {port: dataclasses.asdict(flow) for port, flow in self.flows.items()}}


def udp_port(frame: bytes) -> int | None:
    """The destination; None if the frame is no UDP packet, 0 in a later fragment of one."""
    if (start := udp_start(frame)) is None:
        return 0 if frame[12:ETHERNET] == b"\x08\x00" and frame[ETHERNET + 9] == UDP else None
    return int.from_bytes(frame[start + 2:start + 4], "big")


class Relay:
    def __init__(self, operators: int, delay: float, seed: int, meet: bool = False) -> None:
        self.delay, self.seed = delay, seed
        others = range(2, operators + 2)
        self.ports = [Port(1, others), *(Port(number, [1]) for number in others)]
        self.switched = [Way(port.tap) for port in self.ports] if meet else []
        self.down = [Way(self.ports[1 + one].tap, f"down {one} {seed}") for one in range(operators)]
        self.up = [Way(self.ports[0].tap, f"up {one} {seed}") for one in range(operators)]
        self.waiting: collections.deque[tuple[float, Way, int | None, bytes]] = collections.deque()
        self.late = 0.0  # s, longest wait of a packet beyond its delay

    def ways(self, port: int, frame: bytes) -> list[Way]:
        """The destinations of a frame. Operators do not see each other, unless all meet."""
        if self.switched:
            return [way for number, way in enumerate(self.switched)
                    if number != port and (frame[0] & 1 or frame[:6] == mac(number + 1))]
        if port:
            return [self.up[port - 1]]
        if frame[0] & 1:
            return self.down
        number = frame[5] - 2
        return self.down[number:number + 1] if frame[:5] == mac(0)[:5] and number >= 0 else []

    def take(self, port: int, frame: bytes) -> None:
        now, to = time.monotonic(), udp_port(frame)
        for way in self.ways(port, frame):
            own, added = ([frame], []) if to is None else way.take(to, frame, len(frame) - ETHERNET, now)
            self.waiting.extend((now + self.delay, way, udp_port(one), one) for one in own)
            self.waiting.extend((now + self.delay, way, None, one) for one in added)

    def release(self) -> float | None:
        """Let packets pass that a fault held until now; returns the seconds until the next one is due."""
        now, waits = time.monotonic(), []
        for way in (*self.down, *self.up):
            self.waiting.extend((now + self.delay, way, udp_port(one), one) for one in way.faults.due(now))
            waits.append(way.faults.wait(now))
        return min((wait for wait in waits if wait is not None), default=None)

    def deliver(self) -> float | None:
        """Deliver all due packets; returns the seconds until the next one is due."""
        while self.waiting:
            due, way, to, frame = self.waiting[0]
            now = time.monotonic()
            if now < due:
                return due - now
            self.waiting.popleft()
            self.late = max(self.late, now - due)
            try:
                os.write(way.target, frame)
            except BlockingIOError:
                continue  # not counted in `delivered`
            if to is not None:
                way.arrived(to, len(frame) - ETHERNET)
        return None

    def read(self, port: int) -> None:
        for _ in range(BATCH):
            try:
                self.take(port, os.read(self.ports[port].tap, FRAME_MAX))
            except BlockingIOError:
                return

    def obey(self, order: dict[str, Any]) -> dict[str, Any]:
        for operator, direction, faults in order.get("turn", []):
            way: Way = getattr(self, direction)[operator]
            way.faults.turn({name: loss.judge(loss.unpack(packed), self.seed, operator,
                                              direction if name == "drop" else f"{direction} {name}")
                             for name, packed in faults.items()})
        if "counts" not in order:
            return {}
        return {"down": [way.counts() for way in self.down], "up": [way.counts() for way in self.up],
                "late_ms": 1000 * self.late, "overrun": sum(port.overrun() for port in self.ports)}

    def run(self) -> None:
        taps = {port.tap: number for number, port in enumerate(self.ports)}
        while True:
            held = self.release()  # before deliver(): without a delay they are due at once
            waits = [wait for wait in (held, self.deliver()) if wait is not None]
            for ready in select.select([0, *taps], [], [], min(waits, default=None))[0]:
                if ready:
                    self.read(taps[ready])
                elif line := sys.stdin.readline():
                    print(json.dumps(self.obey(json.loads(line))), flush=True)
                else:
                    return


def main() -> None:
    relay = Relay(int(sys.argv[1]), float(sys.argv[2]) / 1000, int(sys.argv[3]), "meet" in sys.argv[4:])
    # Above the programs at both ends, which may have a real-time priority themselves: their load adds no delay.
    with contextlib.suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(os.sched_getparam(0).sched_priority + 1))
    print(json.dumps([port.namespace for port in relay.ports]), flush=True)
    relay.run()


if __name__ == "__main__":
    main()
