# SPDX-License-Identifier: GPL-2.0-or-later
"""A robot and an operator at both ends of the lossy link, each with a store and the programs of the stream: a clip goes
from one to the other, and what is judged are counts and the numbers in the operator's pictures. A second decode runs on
the robot, where no packet is lost: its pictures show what the encoder made of each number."""
from __future__ import annotations

import dataclasses
import pathlib
import time

from parts.link.link import Counts, Link, Node
from parts.link.loss import NOTHING, Pattern

from .programs import Counters, Desk, start_recorder, stop, wait_until
from .stream import drawn, finish, printed

COARSE = 25  # frames, from the first one, whose pictures may be too coarse for their numbers
LOCAL = "127.0.0.1"

Shown = list[tuple[int, int | None]]  # of each frame shown, the number that it has and the one in its picture


@dataclasses.dataclass
class Outcome:
    """What came of a stream. The counters are those of the programs, but for `counts`, which are the link's."""
    sent: Counters
    sent_packets: dict[str, int]
    shown: Counters
    shown_packets: dict[str, int]
    seen: Shown             # at the operator
    coded: Shown            # on the robot
    counts: Counts
    seconds: float          # from the first frame until all was there

    def wrong_sums(self, *more: tuple[str, int, int]) -> list[str]:
        """Of the sums that hold for every stream, and of others: those whose two sides differ."""
        sent, shown = self.sent, self.shown
        both = [*more, ("robot: in, and out + lost", sent["in"], sent["out"] + sum(sent["lost"].values())),
                ("frames sent and expected", sent["out"], shown["in"]),
                ("operator: in, and out + lost", shown["in"], shown["out"] + sum(shown["lost"].values())),
                ("bytes sent and passed on", self.sent_packets["wire_bytes"], self.counts.down[0].bytes)]
        return [f"{what}: {ours} and {theirs}" for what, ours, theirs in both if ours != theirs]


@dataclasses.dataclass
class Run(Outcome):
    """Of a clip with a mark after it."""

    @property
    def whole(self) -> float:
        """The part of the clip's frames sent that the operator saw, by the numbers in the pictures. The first second's
        do not count: they are small, and a number may not be readable in them yet."""
        right = sum(said == seen for said, seen in of_clip(self.seen) if said >= COARSE)
        return right / (int(self.sent["out"]) - 1 - COARSE)

    def disagreements(self, frames: int) -> list[str]:
        """The sums that are wrong, of a clip of `frames` frames and the mark after it."""
        packets = self.sent_packets["packets"]
        found = self.wrong_sums(("robot: frames written and seen", frames + 1, self.sent["in"]),
                                ("packets sent, and passed on twice", packets, 2 * self.counts.down[0].packets))
        wrong = wrong_numbers(of_clip(self.seen), of_clip(self.coded))
        if wrong:
            found.append(f"numbers printed and in the pictures: {wrong}")
        return found

    def beyond_rate(self, wire: int) -> list[str]:
        """The rules of a rate in kbit/s that the relay saw broken. What waited for a busy relay came to it at once."""
        way, kbit = self.counts.down[0], wire * 1000 / 8
        most = {"mean": (way.bytes / self.seconds, kbit),
                "second": (way.peak, kbit * (1.3 + self.counts.late_ms / 1000))}
        return [f"{name}: {found:.0f} of {limit:.0f} bytes" for name, (found, limit) in most.items() if found > limit]


def of_clip(shown: Shown) -> Shown:
    """Without the mark, which has number 0 again."""
    return shown[:-1] if len(shown) > 1 and shown[-1][0] == 0 else shown


def coarse(coded: Shown) -> Shown:
    """The robot's pictures with another number than their frame's because the rate did not suffice: each block of the
    number shows the frame's bit, or still the one of the picture before. Another frame's picture shows a bit that
    neither of these two has."""
    return [(said, drawn) for (_, before), (said, drawn) in zip(coded, coded[1:])
            if drawn is not None and before is not None and not (drawn ^ said) & (drawn ^ before)]


def wrong_numbers(seen: Shown, coded: Shown) -> Shown:
    """The operator's pictures that are of other frames than decode printed."""
    allowed = set(coarse(coded))
    return [(said, drawn) for said, drawn in seen if drawn not in (said, None) and (said, drawn) not in allowed]


def play(robot: Desk, clip: pathlib.Path, instance: str, *options: object) -> None:
    done = robot.run("ddxvideoload", clip, "-readers", 1, "-instance", instance, *options, timeout=120)
    assert done.returncode == 0, done.stderr


def mark(clip: pathlib.Path, path: pathlib.Path) -> pathlib.Path:
    """The last picture of the clip once more."""
    header, *frames = clip.read_bytes().split(b"FRAME\n")
    path.write_bytes(header + b"FRAME\n" + frames[-1])
    return path


def run(folder: pathlib.Path, clip: pathlib.Path, loss: Pattern, back: Pattern, *options: object) -> Run:
    """The clip through a link that loses packets from the first one on; a mark after it, when the link is good again,
    so that the operator knows of all frames."""
    for name in ("robot", "operator"):
        (folder / name).mkdir(parents=True)
    with Link(loss=loss, back=back, delay_ms=2) as link:
        robot, operator = Desk(folder / "robot"), Desk(folder / "operator")
        try:
            return _run(robot, operator, link, clip, back, options)
        finally:
            operator.end()
            robot.end()


class Screen:
    """decode, and a recorder of its pictures."""

    def __init__(self, desk: Desk, node: Node, *options: object) -> None:
        self.desk = desk
        self.recorder = start_recorder(desk, "-name", "seen", "-output", "seen.y4m")
        wait_until(lambda: "ddxvideosave.stats" in desk.run("ddxctl", "list").stdout)
        self.decode = desk.start("decode", "-headless", "-print", "-name", "seen", "-group", "none", *options,
                                 wrapper=node.inside)
        wait_until(lambda: "decode.packets" in desk.run("ddxctl", "list").stdout)

    def end(self) -> tuple[Shown, dict[str, int], Counters]:
        """What was shown; packets' and frames' counters."""
        (lines, packets, frames), = finish(self.decode)
        assert stop(self.recorder)[0] == 0
        file = self.desk.folder / "seen.y4m"
        said, seen = printed(lines), drawn(file) if file.exists() else []  # without a picture there is no file
        assert len(said) == len(seen) == frames["out"]
        return list(zip(said, seen)), packets, frames


def _run(robot: Desk, operator: Desk, link: Link, clip: pathlib.Path, back: Pattern,
         options: tuple[object, ...]) -> Run:
    far, near = Screen(operator, link.operator[0]), Screen(robot, link.robot, "-silent")
    sender = robot.start("ddxvideosend", "-group", "none", "-to", f"{link.operator[0].address},{LOCAL}", *options,
                         wrapper=link.robot.inside)
    begin = time.monotonic()
    play(robot, clip, "clip")
    wait_until(lambda: settled(robot, "ddxvideosend", robot.sequence("video")))  # the rate has room for the mark
    link.lose(NOTHING, back)
    play(robot, mark(clip, robot.folder / "mark.y4m"), "mark")
    wait_until(lambda: settled(robot, "ddxvideosend", robot.sequence("video")))
    wait_until(lambda: settled(operator, "decode", robot.out("ddxvideosend")))
    seconds = time.monotonic() - begin
    wait_until(lambda: settled(robot, "decode", robot.out("ddxvideosend")))
    (_, sent_packets, sent), = finish(sender)
    seen, shown_packets, shown = far.end()
    coded, _, _ = near.end()
    return Run(sent, sent_packets, shown, shown_packets, seen, coded, link.counts(), seconds)


def settled(desk: Desk, instance: str, frames: int) -> bool:
    """`frames` frames came in, and each one is out or counted as lost."""
    found = desk.stats(instance)
    return bool(found["in"] == frames == found["out"] + sum(found["lost"].values()))
