# SPDX-License-Identifier: GPL-2.0-or-later
"""Power cuts while recording: the short form of `make test-long T=powercut`, and its preconditions."""
import pathlib
import statistics
import subprocess
import time

import pytest

import powercut
from lib.figures import Figure
from parts.disk import blocklog, mbr
from parts.guest import testdisk
from parts.guest.machine import Machine
from parts.guest.qemu import Boot, Guest


pytestmark = [pytest.mark.retry, pytest.mark.long]

CUTS = {powercut.Y4M: 10, powercut.H264: 10, powercut.NAIVE: 4}
SECONDS = 12  # of recording before the cuts
MARK = b"without flushes"


@pytest.mark.parametrize("kind", CUTS)
def test_recordings_survive_power_cuts(boot: Boot, image: pathlib.Path, clip: pathlib.Path, tmp_path: pathlib.Path,
                                       board: Machine, kind: str, record_property: Figure) -> None:
    """The naive recorder must lose more than allowed; otherwise the test proves nothing."""
    if subprocess.run(["losetup", "-f"], capture_output=True, check=False).returncode:
        pytest.skip("no loop devices here: no disk was mounted as a power cut leaves it")
    log = tmp_path / "writes"
    with boot(f"powercut-{kind}", writes=log, **powercut.provide(tmp_path / "test.img", clip, board.board)) as guest:
        powercut.record(guest, kind, SECONDS)
    figures = powercut.summary(list(powercut.replay(log, image, clip, kind, CUTS[kind], 7)))
    for name, value in figures.items():
        record_property(name, value)
    assert figures["cuts"] == 2 * CUTS[kind]
    assert powercut.broken(figures) is (kind == powercut.NAIVE), figures


def mark(guest: Guest) -> None:
    guest.sh(f"printf '{MARK.decode()}' | dd of=/dev/vda{powercut.MARKS} bs=512 conv=sync,notrunc oflag=direct")


def flushes(image: pathlib.Path, log: pathlib.Path) -> tuple[list[int], list[int]]:
    """The number of flushes between consecutive writes of the index, before and after the mark."""
    part = mbr.partition(image, powercut.REC)
    before: list[int] = []
    after: list[int] = []
    found, count, last = before, 0, 0
    for entry in blocklog.entries(log):
        numbers = powercut.promises(entry) if part.begin <= entry.offset < part.end else set()
        if entry.data.startswith(MARK):
            found = after
        count += entry.is_flush
        if numbers and min(numbers) != last + 1:  # otherwise the next block of the same checkpoint
            found += [count] if last else []
            count = 0
        last = max([last, *numbers])
    return before, after


def test_each_checkpoint_is_flushed(boot: Boot, image: pathlib.Path, clip: pathlib.Path, tmp_path: pathlib.Path,
                                 record_property: Figure) -> None:
    """The disk gets two flushes: one for the frames, one for the index that refers to them."""
    log = tmp_path / "writes"
    disk = testdisk.make(tmp_path / "test.img", clip, {"ddxvideoload.conf": "loop=\n"})
    with boot("flushes", writes=log, test_disk=disk) as guest:
        guest.wait_until("ls /rec/pool/*.index")
        time.sleep(10)
        mark(guest)
        guest.sh("mount -o remount,nobarrier /rec")  # proves that the check can fail
        time.sleep(5)
        guest.sh("touch /data/file; fsync /data/file")  # QEMU closes its log at a flush
        guest.process.kill()
    flushed, without = flushes(image, log)
    record_property("flushes_for_each_promise", flushed)
    record_property("without_barriers", without)
    assert len(flushed) > 5 and min(flushed) >= 2 and statistics.mode(flushed) == 2
    assert len(without) > 2 and statistics.mode(without) == 0
