# SPDX-License-Identifier: GPL-2.0-or-later
"""10,000 datagrams of garbage a second at either end of a lossy stream: it goes on, and each datagram is counted,
except those that the kernel reports as dropped because a program was too slow."""
from __future__ import annotations

import dataclasses
import json
import pathlib
import subprocess
import sys

import pytest

from parts.link.link import Node, Way
from parts.link.loss import Iid
from parts.media import clip as numbered_clip

from .lasting import Lasted, Memory, grown, lasting
from .programs import Process
from .stream import PORT

pytestmark = pytest.mark.retry

FLOOD = pathlib.Path(__file__).with_name("flood.py")
RATE = 10000  # datagrams a second, at either end
WIRE = 1000   # kbit/s
LOSS = Iid(0.1)
# Share of whole pictures: forged reports leave little rate for frames, which may then still show an older number.
COARSE = 0.01
KINDS = {PORT: "media", PORT + 1: "reports", PORT + 2: "repair"}
SHORT = 1     # s
WARM_UP, STEP = 5, 5  # frames before the flood, and between samples of the memory
Sent = dict[int, int]
FRAMES = numbered_clip.RATE


def flood(node: Node, ssrc: str, seconds: int, *ports: int) -> subprocess.Popen[str]:
    words = [f"{port}={KINDS[port]}" for port in ports]
    return node.popen([sys.executable, "-B", str(FLOOD), ssrc, str(RATE * seconds), str(RATE), node.address, *words],
                      stdout=subprocess.PIPE)


def dropped(process: Process, port: int) -> int:
    """Datagrams to a port in the process's network that the kernel dropped."""
    lines = [line.split() for kind in ("udp", "udp6")
             for line in pathlib.Path(f"/proc/{process.pid}/net/{kind}").read_text().splitlines()[1:]]
    return sum(int(words[-1]) for words in lines if words[1].endswith(f":{port:04X}"))


def passed(way: Way, port: int) -> int:
    return way.ports[port].delivered if port in way.ports else 0


def miscounted(done: Lasted, sent: Sent, drops: Sent) -> list[str]:
    """Datagrams that came to a port without being counted; garbage that was accepted."""
    ours, theirs = done.shown_packets, done.sent_packets
    made, gone = sent[PORT] + sent[PORT + 2], drops[PORT] + drops[PORT + 2]
    came = sum(passed(done.counts.down[0], port) for port in (PORT, PORT + 2)) + made - gone
    bad = ours["garbage"] + ours["foreign"] + ours["refused"] + ours["repair_refused"]
    reports = sent[PORT + 1] - drops[PORT + 1]
    least, most = (reports + passed(counts.up[0], PORT + 1) for counts in (done.before, done.counts))
    checks = {f"{came} datagrams came to decode": ours["received"] + ours["repair_received"] + ours["refused"] == came,
              f"{made} were garbage, and {gone} dropped": made - gone <= bad <= made,
              f"{least} to {most} reports came": least <= theirs["reports"] <= most,
              f"{reports} were garbage, half of them noise": theirs["reports_unused"] >= reports / 2 - drops[PORT + 1]}
    return [what for what, right in checks.items() if not right]


def run(folder: pathlib.Path, clip: pathlib.Path, seconds: int) -> tuple[Lasted, Sent, Sent, list[Memory]]:
    """The result of the stream, the garbage sent to each port and dropped by the kernel, and the memory."""
    with lasting(folder, clip, LOSS, "-wire", WIRE) as stream:
        stream.wait_for(WARM_UP)
        memory = [stream.memory()]
        floods = [flood(stream.link.operator[0], stream.ssrc(), seconds, PORT, PORT + 2),
                  flood(stream.link.robot, stream.ssrc(), seconds, PORT + 1)]
        while any(one.poll() is None for one in floods):
            memory += stream.samples(STEP, STEP)
        sent = {int(port): count for one in floods for port, count in json.loads(one.communicate()[0]).items()}
        memory.append(stream.memory())
        assert stream.link.counts().overrun == 0
        drops = {PORT + 1: dropped(stream.sender, PORT + 1),
                 **{port: dropped(stream.ends[0].decode, port) for port in (PORT, PORT + 2)}}
        return stream.finish(), sent, drops, memory


def check(done: Lasted, sent: Sent, drops: Sent, memory: list[Memory]) -> float:
    """Check the counts; return the share of frames shown whole."""
    whole = done.right(FRAMES) / int(done.sent["out"])
    print(f"{100 * whole:.1f} % whole, sent {sent}, dropped by the kernel {drops}, memory {memory}\n{done}")
    assert done.disagreements() == []
    assert len(done.wrong(FRAMES)) <= COARSE * len(done.seen)
    assert miscounted(done, sent, drops) == []
    assert sent[PORT] + sent[PORT + 2] >= RATE <= sent[PORT + 1]
    assert done.shown_packets["restored"] > 0 and done.shown_packets["sources"] == 1
    return whole


def test_the_stream_goes_on(tmp_path: pathlib.Path, clip: pathlib.Path) -> None:
    done, sent, drops, memory = run(tmp_path, clip, SHORT)
    assert check(done, sent, drops, memory) > 0.5
    assert grown(memory) == []
    for name in ("received", "repair_received", "refused"):  # a wrong count is found
        wrong = {**done.shown_packets, name: done.shown_packets[name] + 1}
        assert miscounted(dataclasses.replace(done, shown_packets=wrong), sent, drops)


@pytest.mark.long
def test_a_minute_of_flood(tmp_path: pathlib.Path, clip: pathlib.Path) -> None:
    done, sent, drops, memory = run(tmp_path, clip, 60)
    assert check(done, sent, drops, memory) > 0.9
    assert grown(memory) == []
    way, kbit = done.counts.down[0], WIRE * 1000 / 8
    assert way.bytes / done.seconds <= kbit
