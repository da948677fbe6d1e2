# SPDX-License-Identifier: GPL-2.0-or-later
"""A stream inside one guest: the sender, ddxdecode and a recorder of its pictures, all services of the image."""
import dataclasses
import pathlib

from parts.common import Failed
from parts.guest import qemu, session
from parts.media import likeness
from parts.media.counters import Counters, adds_up, agree
from parts.media.likeness import SAME, Likeness, Recording
from parts.media.recording import FileSystem
from parts.media.report import bucket_us

SEND, DECODE = "ddxvideosend", "ddxdecode"
ITEM = "seen"  # ddxdecode's item, see ddxdecode.default
RECORDER = f"ddxvideosave.{ITEM}"
EARLIER = 25  # pictures that ddxdecode may have shown before the recorder had its item


@dataclasses.dataclass(frozen=True)
class Picture:
    """A picture of a recording: its time (ns since the first one) and the number in it."""
    time: int
    number: int | None


@dataclasses.dataclass
class Result:
    sent: Counters
    decoded: Counters
    shown: list[Picture]  # ddxdecode's pictures, from their recording
    wrong: list[int]      # indices of those that differ from the source at their time
    disagreements: list[str]
    likeness: Likeness | None = None  # of a source without numbers in its pictures
    missing: list[int] = dataclasses.field(default_factory=list)  # numbers in recorded pictures that were not shown

    @property
    def lost_send(self) -> int:
        return self.sent.lost_total

    @property
    def lost_decode(self) -> int:
        """Frames that were sent but not shown."""
        return self.sent.out - self.decoded.out


def settings(accel: str) -> dict[str, str]:
    """Settings for a test disk. An emulated processor is too slow for H.264."""
    codec = "mpeg4" if accel.startswith("tcg") else "h264"
    return {f"{SEND}.conf": f"enabled=yes\ncodec={codec}\ninterface=lo\n",
            f"{DECODE}.conf": "enabled=yes\ninterface=lo\n", f"{RECORDER}.conf": f"name={ITEM}\n"}


def stop(guest: qemu.Guest) -> None:
    """After the source has stopped: wait for frames on their way, then stop the sender and ddxdecode."""
    guest.sh(f"sleep 1; for name in {SEND} {DECODE}; do /etc/init.d/S*$name stop; done")


def collect(guest: qemu.Guest, grabber: str, recorded: pathlib.Path, shown: pathlib.Path) -> dict[str, Counters]:
    """After all programs have stopped: extract both recordings without the guest; each program's last counters."""
    partition = FileSystem(guest.snapshot())
    for where in partition.lost():
        print(where)
    partition.take_only("video", recorded)
    partition.take_only(ITEM, shown)
    return {name: session.end_counters(guest, name) for name in (grabber, session.SAVE, SEND, DECODE, RECORDER)}


def pictures(recording: pathlib.Path) -> list[Picture]:
    return numbered(Recording(recording))


def numbered(recording: Recording) -> list[Picture]:
    return [Picture(*one) for one in zip(recording.times, recording.numbers)]


def unlike(shown: list[Picture], source: list[Picture]) -> list[int]:
    """Indices of pictures that differ from the source at their time. The recordings begin at different times, so the
    first numbered picture may match any picture of the source with that number: the best fit counts."""
    first = next((one for one in shown if one.number is not None), None)
    if first is None:
        return list(range(len(shown)))
    best = list(range(len(shown)))
    for begin in (one.time - first.time for one in source if one.number == first.number):
        at = {(one.time - begin + SAME // 2) // SAME: one.number for one in source}
        wrong = []
        for index, one in enumerate(shown):
            key = (one.time + SAME // 2) // SAME
            due = {at[near] for near in (key - 1, key, key + 1) if near in at}
            if one.number not in due or one.number is None:
                wrong.append(index)
        best = min(best, wrong, key=len)
    return best


def alike(shown: Recording, source: Recording) -> Likeness:
    """Compare pictures without numbers by time; both recordings have the same machine's clock."""
    sizes = [f"{one.header.width}x{one.header.height}" for one in (shown, source)]
    if sizes[0] != sizes[1]:
        raise Failed(f"{shown.path.name}: {DECODE} showed {sizes[0]}, but {sizes[1]} was recorded")
    for one in (shown, source):
        if one.start is None:
            raise Failed(f"{one.path.name}: does not say when it was recorded (XDDX_START), so its pictures cannot be "
                         "compared with those of the same time")
    return likeness.compare(shown, source, (shown.start or 0) - (source.start or 0))


def judge(shown: pathlib.Path, recorded: pathlib.Path, sent: Counters, decoded: Counters,
          recorder: Counters) -> Result:
    """Compare ddxdecode's pictures with the recording of the source, and with the counters."""
    ours, source = Recording(shown), Recording(recorded)
    seen = numbered(ours)
    found = None if source.numbered else alike(ours, source)
    wrong = found.wrong if found else unlike(seen, numbered(source))
    missing = sorted({one for one in source.numbers if one is not None} - {one.number for one in seen})
    result = Result(sent, decoded, seen, wrong, [], found, missing)
    agree(result.disagreements, f"pictures of {DECODE} recorded", len(seen), recorder.out)
    agree(result.disagreements, "frames sent and expected", sent.out, decoded.frames_in)
    adds_up(result.disagreements, sent, decoded, recorder)
    if not 0 <= decoded.out - recorder.frames_in <= EARLIER:
        result.disagreements.append(f"{DECODE} showed {decoded.out}, the recorder received {recorder.frames_in}")
    return result


def percentile(histogram: list[int], percent: float) -> float:
    rest = percent / 100 * sum(histogram)
    for index, count in enumerate(histogram):
        rest -= count
        if rest <= 0:
            return bucket_us(index)
    raise AssertionError("no frames")


def windows(marks: list[list[int]]) -> list[list[int]]:
    """The frames between consecutive marks."""
    return [[now - then for now, then in zip(end, begin)] for begin, end in zip(marks, marks[1:])]


def quieter(some: list[list[int]]) -> list[int]:
    """The frames of the better half of the windows: other load on the host makes frames late in one or two windows, a
    fault of the appliance in all."""
    full = sorted((one for one in some if sum(one)), key=lambda one: percentile(one, 99))
    return [sum(counts) for counts in zip(*full[:(len(full) + 1) // 2])]
