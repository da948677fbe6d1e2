# SPDX-License-Identifier: GPL-2.0-or-later
"""A disk that hangs, is full or fails: losses are counted and indexed, and no other program is affected."""
import contextlib
import pathlib
import time
from collections.abc import Iterator

import pytest

from lib.figures import Figure, uptime
from parts.common import PATIENCE
from parts.guest import disk_session, machine, session
from parts.guest.qemu import Boot, Guest
from parts.guest.session import LOAD, SAVE
from parts.guest.slow_disk import SlowDisk

from .conftest import BOARD

pytestmark = [pytest.mark.strict, 
    pytest.mark.long,
    pytest.mark.skipif(BOARD != machine.DEV, reason="its programs are for the development image's processor"),
]

SMALL = 96   # MiB
SOON = 30.0  # s; the goal is 2, but emulated machines are slow


@contextlib.contextmanager
def recording(boot: Boot, work: pathlib.Path, clip: pathlib.Path, name: str, settings: str = "",
              megabytes: int = 2048, cold: bool = True) -> Iterator[tuple[Guest, SlowDisk]]:
    """A guest that records the clip in a loop on a separate disk. `cold`: without files prepared in advance."""
    test = disk_session.test_disk(work, clip, settings)
    with SlowDisk(megabytes) as disk, \
            boot(name, test_disk=test, provision=disk_session.QUIET, extra=disk.drive()) as guest:
        disk_session.prepare(guest, disk)
        disk_session.begin(guest, disk, None, cold=cold)
        yield guest, disk


def out(guest: Guest, program: str) -> int:
    seen = session.follow(guest, 0)
    return seen[program].out if program in seen else 0


def wait_for_out(guest: Guest, program: str, frames: int) -> None:
    """Wait until the program has put out that many more frames."""
    aim = out(guest, program) + frames
    end = time.monotonic() + PATIENCE
    while out(guest, program) < aim:
        assert time.monotonic() < end, f"{program} does not go on"
        time.sleep(0.3)


def source_is_unaffected(guest: Guest) -> None:
    """Check that the clip goes on and the store loses none of its frames."""
    wait_for_out(guest, LOAD, 50)
    load = session.follow(guest, 0)[LOAD]
    assert load.lost_total == 0 and load.starts == 1


def test_a_disk_that_hangs(boot: Boot, work: pathlib.Path, clip: pathlib.Path, record_property: Figure) -> None:
    """Two seconds lose nothing; five are longer than the ring: counters, index and pictures show the same loss."""
    with recording(boot, work, clip, "disk-hangs") as (guest, disk):
        wait_for_out(guest, SAVE, 50)
        disk.frozen(2)
        wait_for_out(guest, SAVE, 50)
        assert session.follow(guest, 0)[SAVE].lost_total == 0
        disk.frozen(5)
        wait_for_out(guest, SAVE, 50)
        source_is_unaffected(guest)
        result = disk_session.end(guest, disk)
    for name, value in {"published": result.found.published, "recorded": result.found.recorded,
                        "lost_by_pictures": result.found.lost, "lost_counted": result.save.lost,
                        "longest_write_ms": result.stall_ms}.items():
        record_property(name, value)
    assert (result.stall_ms or 0) > 4500  # the disk did hang
    assert result.found.disagreements == [] and result.found.wrong == 0
    assert result.found.lost == result.save.lost["ring"] > 20
    assert result.save.lost_total == result.found.lost


def test_a_full_disk(boot: Boot, work: pathlib.Path, clip: pathlib.Path, record_property: Figure) -> None:
    """With the image's settings: the recordings are kept, and the recorder reports that it has stopped."""
    with recording(boot, work, clip, "disk-full", "segment=8\nonce=yes\n", SMALL) as (guest, disk):
        log = f"/run/log/{SAVE}/current"
        guest.wait_until(f'grep -q "recording stopped, No space left" {log}')
        source_is_unaffected(guest)
        assert "! service    ddxvideosave" in guest.sh("ddxctl health || true")
        save = session.end_counters(guest, SAVE)
    record_property("recorder", {"in": save.frames_in, "out": save.out, "lost": save.lost})
    assert save.out > 100 and save.frames_in == save.out + save.lost_total


def test_a_disk_that_fails(boot: Boot, work: pathlib.Path, clip: pathlib.Path, record_property: Figure) -> None:
    """Reported soon, in one line; frames that were not yet safe on disk are counted as lost."""
    with recording(boot, work, clip, "disk-fails", "once=yes\n") as (guest, disk):
        wait_for_out(guest, SAVE, 50)
        log = f"/run/log/{SAVE}/current"
        before = uptime(guest)
        disk.fail()
        guest.wait_until(f'grep -q "recording stopped" {log}', SOON)
        reported = uptime(guest) - before
        record_property("seconds_until_told", round(reported, 1))
        source_is_unaffected(guest)
        assert "! service    ddxvideosave" in guest.sh("ddxctl health || true")
        save = session.end_counters(guest, SAVE)
    assert save.out > 20 and save.frames_in == save.out + save.lost_total
    assert save.lost["write"] > 0
