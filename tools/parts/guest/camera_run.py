# SPDX-License-Identifier: GPL-2.0-or-later
"""The recording of a camera that a clip was shown to: every picture whole, and the one that was due."""
import bisect
import hashlib
import pathlib

from parts.guest.session import Result
from parts.media import y4m
from parts.media.counters import Counters, adds_up, agree
from parts.media.recording import Comparison

MS = 1_000_000       # ns
PERIOD = 40_000_000  # ns, between two frames of the camera
SLACK = 200_000_000  # ns: one picture of the far side's, source.SHOWN_MS
EARLIER = 50         # frames that the grabber may have put into the store before the recorder had the item


def compare(clip: pathlib.Path, recording: pathlib.Path, times: list[int]) -> tuple[Comparison, list[str]]:
    """Frame n of the clip is due from times[n], in ms of the clock that the recording's times are of, as the far side
    wrote them down; where the recording does not tell its clock (XDDX_START), 1 is due where it is first seen. The
    pictures have to be the clip's, byte by byte, and due within SLACK of their time stamps: else they are in
    the list, with both numbers. (In time, not in frames: a far side that was held up shows the next ones quickly.) How
    many frames the camera gave is counted by these as well: a gap of two periods lacks one."""
    numbers = {hashlib.blake2b(frame.data).digest(): number for number, frame in enumerate(y4m.read(clip)[1])}
    result = Comparison(numbered=True)
    begin: int | None = None
    last, wrong = -1, []
    for index, frame in enumerate(y4m.read(recording)[1]):
        time = frame.time if frame.time is not None else -1
        result.unordered += time <= last
        last = time
        result.recorded += 1
        number = numbers.get(hashlib.blake2b(frame.data).digest())
        for parameter in frame.parameters if index == 0 else ():
            if parameter.startswith("XDDX_START="):
                begin = -int(parameter.partition("=")[2])
        if number == 1 and begin is None:
            begin = time - times[1] * MS
        least, due, most = (max(0, bisect.bisect_right(times, (time - begin + slack) / MS) - 1)
                            if begin is not None else 0 for slack in (-SLACK, 0, SLACK))
        if number is None or not least <= number <= most:
            result.foreign.append(index)
            wrong.append(f"{index}: {number} for {due}")
    result.clip = max(result.recorded, 1 + round(last / PERIOD)) if result.recorded else 0
    return result, wrong


def judge(clip: pathlib.Path, recording: pathlib.Path, grab: Counters, save: Counters, times: list[int]) -> Result:
    """What was recorded against what the camera was shown; the programs' counters have to say the same."""
    outside, wrong = compare(clip, recording, times)
    result = Result(grab, save, outside, [])
    agree(result.disagreements, "frames in the recording", outside.recorded, save.out)
    adds_up(result.disagreements, grab, save)
    result.before = grab.out - save.frames_in
    if not 0 <= result.before <= EARLIER:
        result.disagreements.append(f"{grab.out} frames were published, {save.frames_in} received")
    gaps, lost = outside.clip - outside.recorded, grab.lost_total + save.lost_total
    if abs(gaps - lost) > 1:  # the first and the last time stamp are as late as the driver was
        result.disagreements.append(f"frames missing by the time stamps: {gaps}, the programs say {lost}")
    else:
        outside.clip = outside.recorded + lost
    if wrong:
        result.disagreements.append(f"{len(wrong)} recorded frames that were not due, or not the clip's: {wrong[:10]}")
    if outside.unordered:
        result.disagreements.append(f"{outside.unordered} frames without a rising time stamp")
    return result
