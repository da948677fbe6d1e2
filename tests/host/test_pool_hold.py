# SPDX-License-Identifier: GPL-2.0-or-later
"""A full disk's oldest recordings are deleted despite other users' locks, but not while root copies them."""
from __future__ import annotations

import contextlib
import fcntl
import os
import pathlib
import stat
from collections.abc import Iterable, Iterator

import pytest

from .programs import Desk, Process, lost, make_clip, preload, start_recorder, stop, wait_until
from .test_pool import recordings, small_disk

pytestmark = pytest.mark.retry

__all__ = ["small_disk"]  # a fixture
FRAMES = 30  # CIF frames: more than one file holds
OTHER = 12345  # a user that does not exist
# Root without its privileges: file modes and owners apply.
PLAIN = ("setpriv", "--bounding-set=-dac_override,-dac_read_search")


@pytest.fixture
def full(desk: Desk, small_disk: pathlib.Path) -> pathlib.Path:
    """A disk with one recording and room for another."""
    make_clip(desk.folder / "clip.y4m", frames=FRAMES)
    (small_disk / "filler").write_bytes(bytes(20 << 20))
    record(desk)
    return small_disk


def record(desk: Desk) -> None:
    saver = start_recorder(desk, "-output", "rec", "-segment", 4, "-full", "recycle")
    loader = desk.run("ddxvideoload", "clip.y4m", "-readers", "1", "-rate", "8")
    status, saved = stop(saver)
    assert (loader.returncode, status, lost(saved)) == (0, 0, 0), desk.errors(saver)


def start_copy(desk: Desk, file: pathlib.Path, *wrapper: str) -> tuple[Process, pathlib.Path]:
    """Start a copy that has read its file and waits for a stalled disk until the second path is removed."""
    part, stalled = desk.folder / "to" / f"{file.name}.part", desk.folder / "stalled"
    part.parent.mkdir()
    stalled.touch()
    env = ("env", f"LD_PRELOAD={preload('stalled_disk', desk.folder)}", f"STALLED_FSYNC={stalled}")
    copy = desk.start("ddxrecordings", "export", file.name, "to", "-folder", "rec", wrapper=(*env, *wrapper))
    wait_until(lambda: part.exists() and part.stat().st_size == file.stat().st_size)
    return copy, stalled


@contextlib.contextmanager
def locked(paths: Iterable[pathlib.Path]) -> Iterator[None]:
    """Lock files, as any user with read access can."""
    files = [os.open(path, os.O_RDONLY) for path in paths]
    try:
        for file in files:
            fcntl.flock(file, fcntl.LOCK_SH)
        yield
    finally:
        for file in files:
            os.close(file)


def test_only_root_s_copies_protect_a_recording(desk: Desk, full: pathlib.Path) -> None:
    first, second = recordings(desk)
    copy, stalled = start_copy(desk, first)
    with locked([full / "pool", *full.glob("pool/*.*")]):
        for _ in range(2):
            record(desk)
        assert first in recordings(desk) and second not in recordings(desk)
    stalled.unlink()
    assert copy.wait(60) == 0, desk.errors(copy)
    record(desk)
    assert first not in recordings(desk)
    lock = (full / "pool/lock").stat()
    assert stat.S_IMODE(lock.st_mode) == 0o600 and lock.st_uid == (full / "pool").stat().st_uid


def test_a_copy_by_another_user_reports_a_deleted_recording(desk: Desk, full: pathlib.Path) -> None:
    os.chown(full / "pool/lock", OTHER, OTHER)
    first = recordings(desk)[0]
    copy, stalled = start_copy(desk, first, *PLAIN)
    for _ in range(2):
        record(desk)
    assert first not in recordings(desk)
    stalled.unlink()
    assert copy.wait(60) == 1
    said = desk.errors(copy)
    assert "files may be given up for new recordings while they are copied" in said
    assert f"{first.name}: not exported, it was given up for a new recording while it was read" in said
    assert not list((desk.folder / "to").iterdir())
    saver = start_recorder(desk, "-output", "rec", "-segment", 4, wrapper=PLAIN)
    assert saver.wait(60) == 1 and "rec: its pool belongs to another user" in desk.errors(saver)
