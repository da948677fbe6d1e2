# SPDX-License-Identifier: GPL-2.0-or-later
"""An update leaves the disk to a recorder: a pause after each piece, and none while frames wait."""
from __future__ import annotations

import concurrent.futures
import contextlib
import pathlib
import random
import subprocess
import time
from collections.abc import Callable, Iterator

import pytest

from parts.common import run
from parts.disk.logged_device import lacking
from parts.release import update_file

from .programs import Desk, make_clip, preload, start_recorder, wait_until
from .test_stalled_disk import StalledDisk
from .update_disk import NEW, UpdateDisk

pytestmark = pytest.mark.retry

PIECE = 256 << 10
LOOK = 250_000_000  # ns; between two looks at a recorder that is late


class Writer:
    """`ddxupdate write` onto a slow card."""

    def __init__(self, disk: UpdateDisk, library: pathlib.Path) -> None:
        self.disk, self.log = disk, library.with_name("log")
        self.env = {"LD_PRELOAD": str(library), "PACED_LOG": str(self.log)}

    def run(self, folder: pathlib.Path | None = None) -> subprocess.CompletedProcess[str]:
        """With the store in this folder."""
        return self.disk.run("write", stdin=self.disk.update(),
                             env={**self.env, **({"DDX_DIR": str(folder)} if folder else {})})

    def done(self) -> list[tuple[str, int, int]]:
        """All writes and pauses: a write's bytes, and its ns; a pause's ns."""
        lines = self.log.read_text().splitlines() if self.log.exists() else []
        return [(what, int(number), int(more)) for what, number, more in map(str.split, lines)]

    def written(self) -> list[int]:
        return [size for what, size, _ in self.done() if what == "write"]


@pytest.fixture(name="writer")
def _writer(tmp_path: pathlib.Path) -> Iterator[Writer]:
    if reason := lacking():
        pytest.skip(reason)
    (tmp_path / "disk").mkdir()
    with UpdateDisk(tmp_path / "disk", "A") as disk:
        yield Writer(disk, preload("paced", tmp_path))


def test_a_pause_as_long_as_each_piece_took(writer: Writer) -> None:
    assert writer.run().returncode == 0
    done, written = writer.done(), writer.written()
    assert max(written) == PIECE and sum(written) > len(writer.disk.roots[NEW]) and len(done) == 2 * len(written)
    for (what, _, took), (then, pause, _) in zip(done[::2], done[1::2]):
        assert (what, then) == ("write", "sleep")
        assert pause >= took, f"a pause of {pause} ns after a piece that took {took} ns"


def test_what_is_on_the_disk_is_not_written_again(writer: Writer) -> None:
    """After a stream that broke: all but the MiB between the first one and the break, and the first MiB is cleared."""
    root = writer.disk.roots[NEW]
    assert writer.disk.run("write", stdin=writer.disk.update()[:2_500_000], pipe=True).returncode == 1
    assert writer.run().returncode == 0
    cleared, not_again = 1 << 20, 1 << 20
    assert sum(writer.written()) == cleared + len(root) - not_again and writer.disk.slot("B").startswith(root)


def test_no_piece_while_a_recorder_is_late(writer: Writer, desk: Desk) -> None:
    """Its disk hangs, so that more than a second of frames waits. The update goes on when the recorder does."""
    (desk.folder / "rec").mkdir()
    disk = StalledDisk(desk.folder)
    disk.stall("open")
    start_recorder(desk, "-output", "rec", wrapper=disk.wrapper)
    desk.start("ddxvideoload", make_clip(desk.folder / "clip.y4m", "64x48"), "-loop", "-readers", "1")
    wait_until(lambda: int(desk.stats("ddxvideosave")["waiting"]) > 50)

    def waits() -> bool:
        return [what for what, *_ in writer.done()[-8:]] == ["sleep"] * 8 or job.done()

    with concurrent.futures.ThreadPoolExecutor() as pool:
        job = pool.submit(writer.run, desk.folder / "run")
        wait_until(waits)
        # The rate is known after two looks, 250 ms apart; a piece and its pause take 100 ms.
        before = writer.written()
        assert len(before) <= 4, f"{len(before)} pieces were written while the recorder was late"
        assert {pause for _, pause, _ in writer.done()[-7:]} == {LOOK}
        disk.go_on()
        assert job.result().returncode == 0
    assert len(writer.written()) > len(before) and writer.disk.slot("B").startswith(writer.disk.roots[NEW])


@contextlib.contextmanager
def on_file(file: pathlib.Path, size: int) -> Iterator[str]:
    """A device with this file's content, past the page cache."""
    with file.open("wb") as slot:
        slot.truncate(size)
    device = run(["losetup", "--find", "--show", "--direct-io=on", file]).strip()
    yield device
    run(["losetup", "--detach", device])


@pytest.mark.long
def test_the_duration_over_100_mbit(tmp_path: pathlib.Path, record_property: Callable[[str, object], None]) -> None:
    """An update of 18 MB, sent at 100 Mbit/s, while nothing records; onto a file of this machine's disk."""
    if reason := lacking():
        pytest.skip(reason)
    root, rate, piece = random.Random(1).randbytes(18_000_000 // 4096 * 4096), 100e6 / 8, 64 << 10
    (tmp_path / "disk").mkdir()
    with UpdateDisk(tmp_path / "disk", "A") as disk, on_file(tmp_path / "slot", 64 << 20) as device:
        disk.devices[2] = device
        file, begin = update_file.make(NEW, root, disk.key), time.monotonic()

        def pieces() -> Iterator[bytes]:
            for at in range(0, len(file), piece):
                time.sleep(max(0.0, begin + at / rate - time.monotonic()))
                yield file[at:at + piece]

        done = disk.run("write", stdin=pieces())
        record_property("seconds", round(time.monotonic() - begin, 2))
        assert done.returncode == 0, done.stderr
        assert (tmp_path / "slot").read_bytes().startswith(root)
