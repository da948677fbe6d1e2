# SPDX-License-Identifier: GPL-2.0-or-later
"""The lossy link drops exactly the packets of its pattern; its counts are those of both ends."""
from __future__ import annotations

import collections
import itertools
import json
import pathlib
import random
import subprocess
import sys

import pytest

from parts.link import loss
from parts.link.faults import ADDED, FAULTS, LATE, OVERTAKE
from parts.link.link import Counts, Link, Node, Way
from parts.link.relay import Flow
from parts.link.relay import Way as RelayWay

from .programs import wait_until

pytestmark = pytest.mark.retry

PEER = (sys.executable, "-B", "-S", str(pathlib.Path(__file__).with_name("udp_peer.py")))
PORT, GROUP = 8000, "239.255.20.5"
COUNT, SIZE, HEADERS = 1500, 100, 28
FRAME = bytes(14 + HEADERS + SIZE)
PATTERNS = [loss.NOTHING, loss.EveryThird(), loss.Iid(0.3), loss.Bursts(0.3), loss.Outages(0.3, 2),
            loss.Outages(0.3, 2, together=True)]
Peer = subprocess.Popen[str]


def receiver(node: Node, *words: object) -> Peer:
    """Start a receiver and wait until it listens."""
    peer = node.popen([*PEER, "receive", *map(str, words)], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert peer.stdout and peer.stdout.readline() == "ready\n"
    return peer


def sender(node: Node, *words: object) -> Peer:
    return node.popen([*PEER, "send", *map(str, words)])


def came(peer: Peer, delay_ms: float = 0) -> list[int]:
    """The numbers that a receiver saw; none may be earlier than possible."""
    found: dict[str, list[int]] = json.loads(peer.communicate()[0])
    assert all(transit >= delay_ms * 1e6 for transit in found["transit_ns"]) and not found["changed"]
    return found["numbers"]


def all_arrived(link: Link, count: int) -> Counts:
    """Wait until the relay has handled `count` packets in each direction; return the counts."""
    def done() -> bool:
        found = link.counts()
        return all(way.packets == count == way.lost + way.delivered for way in (*found.down, *found.up))

    wait_until(done)
    return link.counts()


def both_ways(link: Link, seconds: float = 0) -> tuple[Counts, list[int], list[int]]:
    """Send numbered packets in both directions; return the counts, and the numbers received at each end."""
    robot, operator = link.robot, link.operator[0]
    receivers = [receiver(operator, PORT), receiver(robot, PORT + 1)]
    extra = [str(seconds)] if seconds else []
    for process in [sender(robot, operator.address, PORT, COUNT, SIZE, *extra),
                    sender(operator, robot.address, PORT + 1, COUNT, SIZE, *extra)]:
        assert process.wait() == 0
    counts = all_arrived(link, COUNT)
    down, up = (came(peer, link.delay_ms) for peer in receivers)
    return counts, down, up


def expected(pattern: loss.Pattern, seed: int, direction: str, operator: int = 0) -> list[int]:
    """The numbers that pass a pattern that does not depend on time."""
    judge = loss.judge(pattern, seed, operator, direction)
    return [number for number in range(COUNT) if not judge(0)]


def disagreements(way: Way, port: int, numbers: list[int]) -> list[str]:
    """Differences between the relay's counts and the packets sent and received."""
    packet = SIZE + HEADERS
    right = Flow(COUNT, COUNT * packet, COUNT - len(numbers), len(numbers), len(numbers) * packet)
    found = [] if way.ports == {port: right} else [f"{way.ports} instead of {port}: {right}"]
    if numbers != sorted(set(numbers)):
        found.append("packets repeated or out of order")
    return found


@pytest.mark.parametrize("pattern", PATTERNS, ids=str)
def test_counts_are_those_of_both_ends(pattern: loss.Pattern) -> None:
    with Link(loss=pattern, delay_ms=1, seed=7) as link:
        counts, down, up = both_ways(link, 0.15 if isinstance(pattern, loss.Outages) else 0)
    assert disagreements(counts.down[0], PORT, down) == [] and disagreements(counts.up[0], PORT + 1, up) == []
    assert disagreements(counts.down[0], PORT, down[:-1])
    assert counts.overrun == 0
    if isinstance(pattern, loss.Outages):
        assert all(0 < len(numbers) < COUNT for numbers in (down, up))
    else:
        assert (down, up) == (expected(pattern, 7, "down"), expected(pattern, 7, "up"))


@pytest.mark.parametrize("together", [False, True])
def test_each_direction_has_outages_of_its_own(together: bool) -> None:
    """Unless they are together: 30 % of the time, in both at once 9 or 30 %."""
    down, up = (loss.judge(loss.Outages(0.3, together=together), 1, 0, way) for way in ("down", "up"))
    both = sum(down(number / 1000) & up(number / 1000) for number in range(200000)) / 200000
    assert both == pytest.approx(0.3 if together else 0.09, rel=0.1)


def test_a_pattern_for_one_direction_and_its_change() -> None:
    """Reports are blocked, then nothing, and later the same packets as in another link with that seed."""
    with Link(seed=5, back=loss.ALL) as link:
        _, down, up = both_ways(link)
        assert (len(down), len(up)) == (COUNT, 0)
    with Link(seed=5) as link:
        link.lose(loss.Iid(0.3))
        _, down, up = both_ways(link)
    assert (down, up) == (expected(loss.Iid(0.3), 5, "down"), expected(loss.Iid(0.3), 5, "up"))
    assert down != expected(loss.Iid(0.3), 6, "down")


def test_a_group_of_four_operators() -> None:
    """A packet of the group is lost independently for each operator; answers go only to the robot."""
    pattern = loss.Iid(0.3)
    with Link(operators=4, loss=pattern, delay_ms=1, seed=3, back=loss.NOTHING) as link:
        receivers = [receiver(node, PORT, GROUP) for node in link.operator]
        reports = receiver(link.robot, PORT + 1)
        senders = [sender(node, link.robot.address, PORT + 1, COUNT, SIZE) for node in link.operator]
        senders.append(sender(link.robot, GROUP, PORT, COUNT, SIZE))
        assert [process.wait() for process in senders] == [0] * 5
        counts = all_arrived(link, COUNT)
        got = [came(peer) for peer in receivers]
        assert sorted(came(reports)) == sorted([*range(COUNT)] * 4)
    assert got == [expected(pattern, 3, "down", number) for number in range(4)]
    assert [disagreements(way, PORT, numbers) for way, numbers in zip(counts.down, got)] == [[]] * 4
    for one, other in itertools.combinations([set(range(COUNT)) - set(numbers) for numbers in got], 2):
        assert 0.06 < len(one & other) / COUNT < 0.12  # 0.3 x 0.3


def test_ipv6() -> None:
    with Link(loss=loss.EveryThird()) as link:
        peer = receiver(link.operator[0], PORT)
        assert sender(link.robot, "fd20::2", PORT, 30, SIZE).wait() == 0
        wait_until(lambda: link.counts().down[0].delivered == 20)
        assert len(came(peer)) == 20
        assert link.counts().down[0].ports[PORT] == Flow(30, 30 * (SIZE + 48), 10, 20, 20 * (SIZE + 48))


@pytest.mark.parametrize("address, headers", [("", HEADERS), ("fd20::2", HEADERS + 20)], ids=["IPv4", "IPv6"])
def test_faults_are_those_that_a_receiver_sees(address: str, headers: int) -> None:
    """Each packet in, and each fault, is in the receiver's counts: the kernel drops what has a wrong checksum."""
    with Link(seed=3) as link:
        link.turn(dict.fromkeys([*FAULTS, *ADDED], loss.Iid(0.1)), {})
        peer = receiver(link.operator[0], PORT)
        assert sender(link.robot, address or link.operator[0].address, PORT, COUNT, SIZE).wait() == 0

        def done() -> bool:
            way = link.counts().down[0]
            return way.packets == COUNT == way.delivered + way.did["drop"] - way.did["duplicate"]

        wait_until(done)
        way = link.counts().down[0]
        found = json.loads(peer.communicate()[0])
    did = way.did
    assert min(did.values()) > 50 and (way.lost, way.packets) == (did["drop"], COUNT)
    assert way.bytes == COUNT * (SIZE + headers)
    numbers, repeated = found["numbers"], collections.Counter(found["numbers"])
    assert len(repeated) == COUNT - did["drop"] - did["damage"] and max(repeated.values()) == 2
    assert len(numbers) == len(repeated) + did["duplicate"]
    assert len(found["changed"]) == sum(did[name] for name in ("damage", *ADDED))
    assert found["changed"].count(SIZE) >= did["damage"] and max(found["changed"]) > SIZE
    late = [transit >= LATE * 1e9 for transit in found["transit_ns"]]
    assert sum(late) >= did["delay"]
    in_time = [number for number, is_late in zip(numbers, late, strict=True) if not is_late]
    overtaken = [sum(earlier > number for earlier in in_time[:at]) for at, number in enumerate(in_time)]
    assert 0 < sum(map(bool, overtaken)) <= did["reorder"]
    assert max(overtaken) <= 2 * OVERTAKE  # some were doubled


@pytest.mark.strict
def test_the_maximum_per_second() -> None:
    """In any interval of a second, not only in those of a clock."""
    way = RelayWay(0)
    for number in range(40):
        assert way.take(PORT, FRAME, 100, number / 8) == ([FRAME], [])
    assert way.peak == 8 * 100
    for now in (6.75, 7.0, 7.71875, 7.96875):
        way.take(PORT, FRAME, 5000, now)
    assert way.peak == 3 * 5000
    assert way.flows == {PORT: Flow(44, 40 * 100 + 4 * 5000)}


@pytest.mark.strict
def test_a_way_loses_first_and_doubles_the_rest() -> None:
    way = RelayWay(0)
    way.lose(loss.EveryThird().judge(random.Random(1)), loss.EveryThird().judge(random.Random(2)))
    copies = [len(way.take(PORT, FRAME, SIZE, number)[0]) for number in range(9)]
    assert sorted(copies) == [0, 0, 0, 1, 1, 1, 1, 2, 2]
    assert way.flows[PORT] == Flow(9, 9 * SIZE, lost=3, doubled=2)


def runs(lost: list[bool]) -> list[int]:
    """Lengths of consecutive losses."""
    return [len(list(group)) for bad, group in itertools.groupby(lost) if bad]


@pytest.mark.strict
@pytest.mark.parametrize("pattern, rate, length", [(loss.EveryThird(), 1 / 3, 1), (loss.Iid(0.1), 0.1, 1 / 0.9),
                                                   (loss.Iid(0.3), 0.3, 1 / 0.7), (loss.Bursts(0.3), 0.3, 5),
                                                   (loss.Bursts(0.1, 3), 0.1, 3), (loss.Outages(0.3), 0.3, 40),
                                                   (loss.Outages(0.1, 200), 0.1, 200)], ids=str)
def test_patterns_have_their_rate_and_burst_length(pattern: loss.Pattern, rate: float, length: float) -> None:
    """Measured with 200,000 packets, one a millisecond."""
    judge = pattern.judge(random.Random(1))
    lost = [judge(number / 1000) for number in range(200000)]
    assert sum(lost) / len(lost) == pytest.approx(rate, rel=0.06)
    in_a_row = runs(lost)
    assert sum(in_a_row) / len(in_a_row) == pytest.approx(length, rel=0.06)
    again = pattern.judge(random.Random(1))
    assert [again(number / 1000) for number in range(2000)] == lost[:2000]
