# SPDX-License-Identifier: GPL-2.0-or-later
"""A stream through the lossy link that runs until the test stops it. Each frame at the operator is judged live by the
number in its picture; nothing is recorded, so it may run for minutes."""
from __future__ import annotations

import contextlib
import dataclasses
import pathlib
import re
import subprocess
import sys
import time
from collections.abc import Iterator

from parts.common import MORTAL
from parts.link.link import Counts, Link, Node, Way
from parts.link.loss import NOTHING, Pattern
from parts.media.clip import HEIGHT, RATE, WIDTH

from .programs import TOP, Counters, Desk, stop, wait_until
from .stream import finish
from .two_ends import Outcome, Shown, play, settled

CLIENT = pathlib.Path(__file__).with_name("numbers_client.py")
Memory = dict[str, int]  # KiB of each program
HANGS = 60               # s
GROWTH = 2048            # KiB, after the first quarter of the samples: less than a second of the flood


class Numbers:
    """The numbers of all frames of item `seen`, and the numbers in their pictures."""

    def __init__(self, desk: Desk) -> None:
        self.path = desk.folder / "numbers"
        environment = {**desk.environment, "PYTHONPATH": f"{TOP}/package/ddx/python:{TOP}/tools"}
        with self.path.open("w") as file:
            self.process = subprocess.Popen([*MORTAL, sys.executable, "-B", str(CLIENT), "seen"], stdout=file,
                                            env=environment)
        wait_until(lambda: bool(self.path.read_text()))

    def wait(self, frames: int) -> Shown:
        """Wait until there are `frames` of them."""
        wait_until(lambda: self.path.read_text().count("\n") > frames)
        words = [line.split() for line in self.path.read_text().splitlines()[1:]]
        return [(int(said), None if drawn == "-" else int(drawn)) for said, drawn in words]

    def end(self) -> None:
        self.process.terminate()
        self.process.wait()


class End:
    """ddxdecode at one end, and the frames it shows."""

    def __init__(self, desk: Desk, node: Node, *options: object) -> None:
        self.desk, self.numbers = desk, Numbers(desk)
        self.decode = desk.start("ddxdecode", "-headless", "-name", "seen", "-group", "none", *options,
                                 wrapper=node.inside)
        wait_until(lambda: "ddxdecode.packets" in desk.run("ddxctl", "list").stdout)

    def finish(self) -> tuple[Shown, dict[str, int], Counters]:
        """Return the frames shown, and the counters of packets and frames."""
        seen = self.numbers.wait(self.desk.out("ddxdecode"))
        (_, packets, frames), = finish(self.decode)
        return seen, packets, frames


@dataclasses.dataclass
class Lasted(Outcome):
    """The result of a stopped stream; `coded` is empty without a ddxdecode on the robot."""
    before: Counts          # the link's counts when the sender was stopped

    def right(self, frames: int) -> int:
        """The count of pictures that show their frame's number, for a clip of `frames` frames."""
        return sum(said % frames == drawn for said, drawn in self.seen)

    def disagreements(self) -> list[str]:
        """Sums of counters that are wrong."""
        return self.wrong_sums(("frames counted and seen", self.shown["out"], len(self.seen)))

    def wrong(self, frames: int) -> Shown:
        """Pictures that do not show the number that ddxdecode reported. A coarse picture may show another number, but
        then ddxdecode on the robot, which misses no packet, has the same picture."""
        coded = dict(self.coded)
        return [(said, drawn) for said, drawn in self.seen
                if drawn not in (None, said % frames, coded.get(said))]


class Lasting:
    """A running stream; see lasting()."""

    def __init__(self, link: Link, robot: Desk, ends: list[End], clip: pathlib.Path, back: Pattern,
                 *options: object) -> None:
        self.link, self.robot, self.ends, self.clip, self.back = link, robot, ends, clip, back
        to = [link.operator[0].address, "127.0.0.1"][:len(ends)]
        self.sender = robot.start("ddxvideosend", "-group", "none", "-to", ",".join(to), *options,
                                  wrapper=link.robot.inside)
        self.begin = time.monotonic()
        self.loader = robot.start("ddxvideoload", clip, "-loop", "-readers", 1)

    def wait_for(self, frames: int) -> None:
        """Wait until `frames` frames have reached the sender."""
        end = time.monotonic() + HANGS
        while int(self.robot.stats("ddxvideosend")["in"]) < frames:
            assert time.monotonic() < end, "no frames come to the sender"
            time.sleep(0.1)

    def ssrc(self) -> str:
        found = re.search(r"SSRC (\w+)", self.robot.errors(self.sender))
        assert found
        return found[1]

    def memory(self) -> Memory:
        """The programs' resident memory in KiB."""
        named = {"sender": self.sender, "decode": self.ends[0].decode}
        return {name: resident(process.pid) for name, process in named.items()}

    def samples(self, frames: int, step: int = RATE) -> Iterator[Memory]:
        """Sample the memory every `step` frames, until `frames` more frames have come."""
        begin = self.robot.stats("ddxvideosend")["in"]
        for number in range(begin + step, begin + frames + 1, step):
            self.wait_for(number)
            yield self.memory()

    def finish(self) -> Lasted:
        """Stop the clip; send a last frame over a good link, so that the operator knows of all frames."""
        assert stop(self.loader)[0] == 0
        self.settle()
        self.link.lose(NOTHING, self.back)
        play(self.robot, first_frame(self.clip, self.robot.folder / "mark.y4m"), "mark")
        self.settle()
        wait_until(lambda: all(settled(end.desk, "ddxdecode", self.robot.out("ddxvideosend")) for end in self.ends))
        before, seconds = self.link.counts(), time.monotonic() - self.begin
        (_, sent_packets, sent), = finish(self.sender)
        wait_until(lambda: passed_on(self.link.counts().down[0], sent_packets["wire_bytes"]))
        seen, shown_packets, shown = self.ends[0].finish()
        coded = [one for end in self.ends[1:] for one in end.finish()[0]]
        return Lasted(sent, sent_packets, shown, shown_packets, seen, coded, self.link.counts(), seconds, before)

    def settle(self) -> None:
        wait_until(lambda: settled(self.robot, "ddxvideosend", self.robot.sequence("video")))


@contextlib.contextmanager
def lasting(folder: pathlib.Path, clip: pathlib.Path, loss: Pattern, *options: object,
            local: bool = False) -> Iterator[Lasting]:
    """Start a stream of a clip that plays in a loop. `local`: also run a ddxdecode on the robot."""
    with Link(delay_ms=2) as link, contextlib.ExitStack() as stack:
        desks = []
        for name in ("robot", "operator"):
            (folder / name).mkdir(parents=True)
            desks.append(Desk(folder / name))
            stack.callback(desks[-1].end)
        robot, operator = desks
        ends = [End(operator, link.operator[0])]
        if local:
            ends.append(End(robot, link.robot, "-silent"))
        for end in ends:
            stack.callback(end.numbers.end)
        stream = Lasting(link, robot, ends, clip, loss, *options)
        wait_until(lambda: all(end.desk.out("ddxdecode") for end in ends))  # ddxdecode does not know earlier frames
        link.lose(loss)
        yield stream


def passed_on(way: Way, size: int) -> bool:
    """Whether `size` bytes have reached the link, and no packet is on its way."""
    return way.bytes >= size and way.packets == way.lost + way.delivered


def first_frame(clip: pathlib.Path, path: pathlib.Path) -> pathlib.Path:
    with clip.open("rb") as file:
        path.write_bytes(file.readline() + file.read(len(b"FRAME\n") + WIDTH * HEIGHT * 3 // 2))
    return path


def grown(samples: list[Memory]) -> list[str]:
    """Programs that hold more memory at the end than after the first quarter of the samples."""
    first, last = samples[len(samples) // 4], samples[-1]
    return [f"{name}: {first[name]} KiB, then {last[name]}" for name in first if last[name] - first[name] > GROWTH]


def resident(pid: int) -> int:
    """VmRSS, in KiB."""
    line = next(line for line in pathlib.Path(f"/proc/{pid}/status").read_text().splitlines() if "VmRSS" in line)
    return int(line.split()[1])
