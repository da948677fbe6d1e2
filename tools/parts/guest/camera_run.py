# SPDX-License-Identifier: GPL-2.0-or-later
"""Check the recording of a camera that was shown a clip: each picture is whole and was due at its time."""
import bisect
import hashlib
import pathlib

from parts.guest.session import Result
from parts.media import y4m
from parts.media.counters import Counters, adds_up, agree
from parts.media.recording import Comparison

MS = 1_000_000       # ns
PERIOD = 40_000_000  # ns, between two frames of the camera
SLACK = 200_000_000  # ns: one picture of the clip, source.SHOWN_MS
EARLIER = 50         # frames that the grabber may have written before the recorder read the item


def compare(clip: pathlib.Path, recording: pathlib.Path, times: list[int]) -> tuple[Comparison, list[str]]:
    """Frame n of the clip is due from times[n], in ms of the clock of the recording's times, as logged by the program
    that shows the clip; without XDDX_START in the recording, frame 1 is due when it is first seen. Pictures must equal
    the clip's byte for byte and be due within SLACK of their time stamps; the others are listed with both numbers.
    (SLACK is a time, not frames: after a delay, that program shows the next pictures quickly.) The camera's frames are
    counted by time stamps: in a gap of two periods one frame is missing."""
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
    """Compare the recording with what the camera was shown, and with the programs' counters."""
    outside, wrong = compare(clip, recording, times)
    result = Result(grab, save, outside, [])
    agree(result.disagreements, "frames in the recording", outside.recorded, save.out)
    adds_up(result.disagreements, grab, save)
    result.before = grab.out - save.frames_in
    if not 0 <= result.before <= EARLIER:
        result.disagreements.append(f"{grab.out} frames were published, {save.frames_in} received")
    gaps, lost = outside.clip - outside.recorded, grab.lost_total + save.lost_total
    if abs(gaps - lost) > 1:  # the driver may be late with the first and the last time stamp
        result.disagreements.append(f"frames missing by the time stamps: {gaps}, the programs say {lost}")
    else:
        outside.clip = outside.recorded + lost
    if wrong:
        result.disagreements.append(f"{len(wrong)} recorded frames that were not due, or not the clip's: {wrong[:10]}")
    if outside.unordered:
        result.disagreements.append(f"{outside.unordered} frames without a rising time stamp")
    return result
