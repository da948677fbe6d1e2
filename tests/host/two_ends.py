# SPDX-License-Identifier: GPL-2.0-or-later
"""A robot and an operator at the ends of the lossy link, each with a store and the programs of the stream. A clip is
sent to the operator, and judged by counts and the numbers in the pictures. A second ddxdecode runs on the robot, where
no packet is lost: its pictures show how the encoder changed each number."""
from __future__ import annotations

import dataclasses
import pathlib
import time

from parts.link.link import Counts, Link, Node
from parts.link.loss import NOTHING, Pattern

from .programs import Counters, Desk, start_recorder, stop, wait_until
from .stream import drawn, finish, printed

COARSE = 25  # first frames, whose pictures may be too coarse for their numbers
LOCAL = "127.0.0.1"

Shown = list[tuple[int, int | None]]  # for each shown frame: its number, and the number in its picture


@dataclasses.dataclass
class Outcome:
    """The result of a stream. `counts` are the link's, all others the programs' counters."""
    sent: Counters
    sent_packets: dict[str, int]
    shown: Counters
    shown_packets: dict[str, int]
    seen: Shown             # at the operator
    coded: Shown            # on the robot
    counts: Counts
    seconds: float          # from the first frame until all had arrived

    def wrong_sums(self, *more: tuple[str, int, int]) -> list[str]:
        """Sums of every stream, and `more`, whose two sides differ."""
        sent, shown = self.sent, self.shown
        both = [*more, ("robot: in, and out + lost", sent["in"], sent["out"] + sum(sent["lost"].values())),
                ("frames sent and expected", sent["out"], shown["in"]),
                ("operator: in, and out + lost", shown["in"], shown["out"] + sum(shown["lost"].values())),
                ("bytes sent and passed on", self.sent_packets["wire_bytes"], self.counts.down[0].bytes)]
        return [f"{what}: {ours} and {theirs}" for what, ours, theirs in both if ours != theirs]


@dataclasses.dataclass
class Run(Outcome):
    """The result of a clip with a mark after it."""

    @property
    def whole(self) -> float:
        """The share of sent frames that the operator saw, by the numbers in the pictures. The first second does not
        count: its numbers may not be readable yet."""
        right = sum(said == seen for said, seen in of_clip(self.seen) if said >= COARSE)
        return right / (int(self.sent["out"]) - 1 - COARSE)

    def disagreements(self, frames: int) -> list[str]:
        """Wrong sums for a clip of `frames` frames and the mark after it."""
        packets = self.sent_packets["packets"]
        found = self.wrong_sums(("robot: frames written and seen", frames + 1, self.sent["in"]),
                                ("packets sent, and passed on twice", packets, 2 * self.counts.down[0].packets))
        wrong = wrong_numbers(of_clip(self.seen), of_clip(self.coded))
        if wrong:
            found.append(f"numbers printed and in the pictures: {wrong}")
        return found

    def beyond_rate(self, wire: int) -> list[str]:
        """Limits of a rate in kbit/s that were exceeded at the relay, which may receive waiting packets in a burst."""
        way, kbit = self.counts.down[0], wire * 1000 / 8
        most = {"mean": (way.bytes / self.seconds, kbit),
                "second": (way.peak, kbit * (1.3 + self.counts.late_ms / 1000))}
        return [f"{name}: {found:.0f} of {limit:.0f} bytes" for name, (found, limit) in most.items() if found > limit]


def of_clip(shown: Shown) -> Shown:
    """The frames without the mark, which has number 0 again."""
    return shown[:-1] if len(shown) > 1 and shown[-1][0] == 0 else shown


def coarse(coded: Shown) -> Shown:
    """The robot's pictures with a wrong number because the rate was too low: each block of the number shows the frame's
    bit, or still that of the picture before. A wrong frame's picture shows a bit that neither of the two has."""
    return [(said, drawn) for (_, before), (said, drawn) in zip(coded, coded[1:])
            if drawn is not None and before is not None and not (drawn ^ said) & (drawn ^ before)]


def wrong_numbers(seen: Shown, coded: Shown) -> Shown:
    """The operator's pictures that do not belong to the printed frame."""
    allowed = set(coarse(coded))
    return [(said, drawn) for said, drawn in seen if drawn not in (said, None) and (said, drawn) not in allowed]


def play(robot: Desk, clip: pathlib.Path, instance: str, *options: object) -> None:
    done = robot.run("ddxvideoload", clip, "-readers", 1, "-instance", instance, *options, timeout=120)
    assert done.returncode == 0, done.stderr


def mark(clip: pathlib.Path, path: pathlib.Path) -> pathlib.Path:
    """Write a clip with only the last picture of the clip."""
    header, *frames = clip.read_bytes().split(b"FRAME\n")
    path.write_bytes(header + b"FRAME\n" + frames[-1])
    return path


def run(folder: pathlib.Path, clip: pathlib.Path, loss: Pattern, back: Pattern, *options: object) -> Run:
    """Send the clip through a link that loses packets from the first one on, then a mark over a good link, so that the
    operator knows of all frames."""
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
    """ddxdecode and a recorder of its pictures."""

    def __init__(self, desk: Desk, node: Node, *options: object) -> None:
        self.desk = desk
        self.recorder = start_recorder(desk, "-name", "seen", "-output", "seen.y4m")
        wait_until(lambda: "ddxvideosave.stats" in desk.run("ddxctl", "list").stdout)
        self.decode = desk.start("ddxdecode", "-headless", "-print", "-name", "seen", "-group", "none", *options,
                                 wrapper=node.inside)
        wait_until(lambda: "ddxdecode.packets" in desk.run("ddxctl", "list").stdout)

    def end(self) -> tuple[Shown, dict[str, int], Counters]:
        """Return the frames shown, and the counters of packets and frames."""
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
    wait_until(lambda: settled(robot, "ddxvideosend", robot.sequence("video")))  # leaves rate for the mark
    link.lose(NOTHING, back)
    play(robot, mark(clip, robot.folder / "mark.y4m"), "mark")
    wait_until(lambda: settled(robot, "ddxvideosend", robot.sequence("video")))
    wait_until(lambda: settled(operator, "ddxdecode", robot.out("ddxvideosend")))
    seconds = time.monotonic() - begin
    wait_until(lambda: settled(robot, "ddxdecode", robot.out("ddxvideosend")))
    (_, sent_packets, sent), = finish(sender)
    seen, shown_packets, shown = far.end()
    coded, _, _ = near.end()
    return Run(sent, sent_packets, shown, shown_packets, seen, coded, link.counts(), seconds)


def settled(desk: Desk, instance: str, frames: int) -> bool:
    """Whether `frames` frames came in, and each is out or counted as lost."""
    found = desk.stats(instance)
    return bool(found["in"] == frames == found["out"] + sum(found["lost"].values()))
