# SPDX-License-Identifier: GPL-2.0-or-later
"""A wrong clock harms no recording: none is overwritten, they keep their order, and clock steps lose no frame."""
import hashlib
import pathlib

import pytest

from parts.guest import session, testdisk
from parts.guest.qemu import Boot, Guest
from parts.media import clip as default_clip
from parts.media.recording import FileSystem, compare

from . import camera

pytestmark = [pytest.mark.retry, pytest.mark.long]

SECONDS = 4
FRAMES = SECONDS * default_clip.RATE
# The hardware clock at each boot, and the date in the recording's name.
CLOCKS = [("2026-03-01T12:00:00", "20260301"), ("1970-01-01T00:00:10", "19700101"), ("2038-01-19T03:14:00", "20380119"),
          ("1970-01-01T00:00:10", "19700101")]


def recordings(guest: Guest, work: pathlib.Path) -> dict[str, pathlib.Path]:
    """All recordings by the name of their first file, in the order of their numbers."""
    partition = FileSystem(guest.snapshot())
    return {names[0]: partition.take_all(names, work / f"clock-{names[0]}") for names in partition.recordings()}


def test_recordings_of_any_year_stay_and_keep_their_order(boot: Boot, work: pathlib.Path,
                                                          tmp_path: pathlib.Path) -> None:
    clip = default_clip.write(work / "clock.y4m", SECONDS)
    disk = testdisk.make(work / "clock.img", clip)
    digests: dict[str, str] = {}
    for number, (clock, day) in enumerate(CLOCKS, 1):
        with boot("clock", test_disk=disk, keep=tmp_path, extra=("-rtc", f"base={clock}")) as guest:
            guest.shell()
            session.wait_for_clip(guest, FRAMES)
            assert guest.sh("date -u +%Y%m%d") == day
            session.stop_recorder(guest)
            found = recordings(guest, work)
            guest.poweroff()
        last = list(found)[-1]
        assert len(found) == number and f"-{number:06d}-{day}T" in last
        assert compare(clip, found[last]).missing == []
        now = {name: hashlib.sha256(path.read_bytes()).hexdigest() for name, path in found.items()}
        assert {name: now[name] for name in digests} == digests  # older recordings are unchanged
        digests = now


def test_a_clock_step_loses_no_frame(boot: Boot, work: pathlib.Path, clip: pathlib.Path) -> None:
    disk = testdisk.make(work / "step.img", clip)
    with boot("step", test_disk=disk) as guest:
        for step in ("2001-01-01 00:00:00", "2037-12-31 23:59:59", "1999-06-01 12:00:00"):
            camera.wait_for_frames(guest, 50, session.LOAD)
            guest.sh(f"date -u -s '{step}'")
        session.wait_for_clip(guest, default_clip.SECONDS * default_clip.RATE)
        session.stop_recorder(guest)
        result = session.collect(guest, clip, work / "step.y4m")
    assert result.good, result.disagreements
