# SPDX-License-Identifier: GPL-2.0-or-later
"""Attacks of another machine in the network on a robot by its catalog; docs/catalog.md has a table of them."""
from __future__ import annotations

import pathlib
import re
import socket
import struct
import sys
import time

import pytest

from parts.link.link import Link

from .programs import Process, lost, make_clip, pictures, result, start_recorder, stop, wait_until
from .test_catalog import Machine, link, read
from .test_catalog_lasting import look
from .test_catalog_peers import HERE, Begin, Laptop, begin, laptop, others

pytestmark = pytest.mark.retry

__all__ = ["begin", "laptop", "link", "others"]  # fixtures

MOST = 16384  # KiB by which the catalog may grow under any attack
DEEP, KEYS = 16, 1000  # as in hostile_catalog.py
FORGED, PARTICIPANTS = 2000, 64
LIMIT = 4096  # bytes a second
ENDPOINTS, TOO_LONG, LEASE, LEASES = 2048, 17000, 30, 300
FEW = 4096  # KiB by which it may grow for these: a participant needs 6 KiB
PORT = 7410   # of the first catalog of a network
NEAR, FAR = 5001, 5002  # ports that forged participants name
FRAMES = 300
DISTANT = "198.51.100.9"


def hostile(laptop: Laptop, word: str) -> Process:
    process = laptop.start("python", HERE / "hostile_catalog.py", word)
    assert int(read(process, 1)[0])
    return process


def grows(robot: Machine, before: int) -> bool:
    return look(robot.catalog)[0] > before + MOST


def refused(robot: Machine) -> int:
    return int(robot.shown()["refused"])


def test_small_records_with_large_types(begin: Begin, laptop: Laptop) -> None:
    robot = begin("")
    before = look(robot.catalog)[0]
    hostile(laptop, "memory")
    wait_until(lambda: bool(robot.shown()["machines"]) and (refused(robot) == DEEP or grows(robot, before)))
    assert not grows(robot, before)
    assert re.search(r"machine m1 \(1\): its record of i[0-9]+ is left out", robot.desk.errors(robot.catalog))


def test_long_keys(begin: Begin, laptop: Laptop) -> None:
    """Of records, which are counted, and of records withdrawn without having been there."""
    robot = begin("")
    before = look(robot.catalog)[0]
    attacker = hostile(laptop, "keys")
    read(attacker, 1)
    wait_until(lambda: [one["items"] for one in robot.shown()["machines"]] == [1])
    assert refused(robot) == KEYS and not grows(robot, before)
    # The records may come before the one with the machine's name.
    assert re.search(r"machine (m1|\?) \(1\): its record of [0-9]+x+ is left out", robot.desk.errors(robot.catalog))


def test_a_flood_of_records(begin: Begin, laptop: Laptop) -> None:
    """Requests are answered, and the catalog stops at once."""
    robot = begin("")
    before = look(robot.catalog)[0]
    hostile(laptop, "flood")
    wait_until(lambda: refused(robot) > 100)
    shown = robot.desk.run("ddxctl", "show", "carol:gps", timeout=20)
    assert "no machine of this name is known to the catalog" in shown.stderr
    assert not grows(robot, before)
    status, _ = stop(robot.catalog)
    assert status == 0


def test_a_forged_name(begin: Begin, laptop: Laptop) -> None:
    """A record alone does not rename the robot. At its start it gives way, and then takes its name again."""
    robot = begin("")
    wait_until(lambda: any(one["name"] == "catalog.machines" for one in robot.shown()["items"]))  # it is announced
    hostile(laptop, "name")
    wait_until(lambda: any(re.fullmatch("robot.*:gps", one["name"]) for one in robot.shown()["items"]))
    wait_until(lambda: bool(robot.table()["same"] == 1))
    assert robot.table()["name"] == "robot"
    stop(robot.catalog)
    robot.catalog = robot.start_catalog()
    wait_until(lambda: "others see this one as robot-" in robot.desk.errors(robot.catalog))
    wait_until(lambda: bool(robot.table()["name"] == "robot"))


def prefix_of(number: int) -> bytes:
    return b"\x01\x10" + struct.pack(">II", 0xabcdef00, number) + b"\0\1"


def parameter(kind: int, value: bytes) -> bytes:
    return struct.pack("<HH", kind, len(value)) + value


def packet(number: int, messages: list[bytes]) -> bytes:
    # Of Fast DDS: of a writer of Cyclone DDS, a heartbeat has to come first.
    return b"RTPS\2\1\1\x0f" + prefix_of(number) + b"".join(
        struct.pack("<BBH", 0x15, 5, len(message)) + message for message in messages)


def participant(number: int, address: str, port: int, more: bytes = b"", lease: int = 3600) -> bytes:
    """The announcement of a participant with a lease in seconds, and the address that discovery is to be sent to."""
    prefix = prefix_of(number)
    locator = struct.pack("<iI", 1, port) + bytes(12) + socket.inet_aton(address)
    body = b"".join([b"\0\3\0\0", parameter(0x15, b"\2\1\0\0"), parameter(0x16, b"\1\x10\0\0"),
                     parameter(2, struct.pack("<iI", lease, 0)), parameter(0x50, prefix + b"\0\0\1\xc1"),
                     parameter(0x58, struct.pack("<I", 0xc3f)), parameter(0x31, locator), parameter(0x32, locator),
                     parameter(0x0f, struct.pack("<I", 0)), more, parameter(1, b"")])
    return packet(number, [struct.pack("<HH", 0, 16) + b"\0\1\0\xc7" + b"\0\1\0\xc2" + struct.pack("<iI", 0, 1) + body])


def writer(number: int, sequence: int) -> bytes:
    """The announcement of a writer by this participant."""
    guid = prefix_of(number) + struct.pack(">I", sequence << 8 | 3)  # without a key
    name = parameter(5, struct.pack("<I", 4) + b"abc\0")
    body = b"\0\3\0\0" + parameter(0x5a, guid) + name + parameter(7, name[4:]) + parameter(1, b"")
    return struct.pack("<HH", 0, 16) + b"\0\0\3\xc7" + b"\0\0\3\xc2" + struct.pack("<iI", 0, sequence) + body


def announce(link: Link, packets: list[bytes]) -> None:
    """Send them from the operator to the robot, a few at a time."""
    text = f"""
import socket, sys, time
out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
for number, line in enumerate(sys.stdin):
    out.sendto(bytes.fromhex(line), ("{link.robot.address}", {PORT}))
    if number % 20 == 19:
        time.sleep(0.01)
"""
    link.operator[0].run([sys.executable, "-c", text], input="\n".join(one.hex() for one in packets))


def sent(link: Link, port: int) -> int:
    """Bytes that the robot has sent to this port."""
    ports = link.counts().down[0].ports
    return ports[port].bytes if port in ports else 0


def announce_again(link: Link, robot: Machine, packets: list[bytes], least: int) -> int:
    """Send them until at least this number was refused, since a busy robot misses some; how often they were sent."""
    attempts = 0

    def all_have_come() -> bool:
        nonlocal attempts
        attempts += 1
        announce(link, packets)
        return refused(robot) >= least

    wait_until(all_have_come)
    return attempts


def test_forged_participants(begin: Begin, link: Link) -> None:
    """Few are known at a time, and nothing is sent to addresses outside of the robot's network."""
    robot, operator = begin("multicast no\n"), link.operator[0]
    link.robot.run(["ip", "route", "replace", "default", "via", operator.address])
    far = [participant(number, DISTANT, FAR) for number in range(20)]
    near = [participant(1000 + number, operator.address, NEAR) for number in range(FORGED)]
    before = look(robot.catalog)[0]
    attempts = announce_again(link, robot, far + near, FORGED - 2 * PARTICIPANTS)
    assert look(robot.catalog)[0] < before + FEW
    wait_until(lambda: sent(link, NEAR) > PARTICIPANTS * 100)
    assert sent(link, FAR) == 0
    assert sent(link, NEAR) < 3 * attempts * sum(map(len, near))


def test_forged_writers(begin: Begin, link: Link) -> None:
    """And a participant that says too much about itself."""
    robot, operator = begin("multicast no\n"), link.operator[0]
    before, own = look(robot.catalog)[0], participant(1, operator.address, NEAR)
    writers = [writer(1, sequence) for sequence in range(1, ENDPOINTS + 100)]
    packets = [packet(1, writers[i:i + 10]) for i in range(0, len(writers), 10)]
    large = participant(2, operator.address, NEAR, parameter(0x2c, struct.pack("<I", TOO_LONG) + bytes(TOO_LONG)))
    announce(link, [large])
    wait_until(lambda: refused(robot) == 1)
    attempts = announce_again(link, robot, [own, *packets], 101)
    # Of each attempt those beyond the limit, which the writers that each participant has count for, too.
    assert refused(robot) < 1 + 120 * attempts and not grows(robot, before)


def test_leases_that_end_at_once(begin: Begin, link: Link) -> None:
    """A new participant is then forgotten while it is still being made."""
    robot, operator = begin("multicast no\n"), link.operator[0]
    for first in range(0, 3 * LEASES, LEASES):
        announce(link, [participant(first + i, operator.address, NEAR, lease=0) for i in range(LEASES)])
    wait_until(lambda: robot.catalog.poll() is not None or refused(robot) > LEASES)
    assert robot.catalog.poll() is None


@pytest.mark.long
def test_a_forged_participant_is_forgotten(begin: Begin, link: Link) -> None:
    """However long it is to be kept: then there is room for others."""
    robot, operator = begin("multicast no\n"), link.operator[0]
    near = [participant(number, operator.address, NEAR) for number in range(PARTICIPANTS)]
    since = time.monotonic()
    announce(link, near)
    wait_until(lambda: sent(link, NEAR) > 0)

    def goes_on() -> bool:
        before = sent(link, NEAR)
        time.sleep(3)
        return sent(link, NEAR) > before

    assert goes_on()
    wait_until(lambda: not goes_on(), LEASE * 3)
    assert time.monotonic() - since > LEASE and refused(robot) == 0


def test_the_limit_of_bytes(begin: Begin, link: Link) -> None:
    """The limit of the rate holds for answers to forged participants, too."""
    begin(f"bandwidth {LIMIT >> 10}K\nmulticast no\n")
    near = [participant(number, link.operator[0].address, NEAR) for number in range(PARTICIPANTS)]
    since = time.monotonic()
    announce(link, near)
    wait_until(lambda: sent(link, NEAR) > 1.5 * LIMIT)
    sent_bytes = link.counts().down[0].bytes  # headers of IP and of fragments included, which the catalog does not see
    assert sent_bytes < 1.25 * (LIMIT / 2 * (time.monotonic() - since) + LIMIT)


@pytest.mark.strict
def test_the_recorder_loses_nothing(begin: Begin, laptop: Laptop, link: Link, tmp_path: pathlib.Path) -> None:
    """Under all attacks at a time."""
    robot, record = begin(""), tmp_path / "record.y4m"
    desk, clip = robot.desk, make_clip(tmp_path / "clip.y4m", "352x288", "100", FRAMES)
    words = ("flood", "name", "memory", "keys")
    attackers = [laptop.start("python", HERE / "hostile_catalog.py", word) for word in words]
    for attacker in attackers:
        read(attacker, 1)
    saver = start_recorder(desk, "-output", record)
    loader = desk.start("ddxvideoload", clip, "-readers", 1)
    wait_until(lambda: desk.sequence("video") > 1)
    seen = refused(robot)
    announce(link, [participant(number, link.operator[0].address, NEAR) for number in range(FORGED)])
    status, loaded = result(loader)
    assert status == 0 and refused(robot) > seen + FORGED / 2  # the attacks went on meanwhile
    assert all(attacker.poll() is None for attacker in attackers) and robot.catalog.poll() is None
    status, saved = stop(saver)
    assert status == 0 and loaded["out"] == saved["in"] == saved["out"] == FRAMES and lost(saved) == lost(loaded) == 0
    assert pictures(record) == pictures(clip)
