# SPDX-License-Identifier: GPL-2.0-or-later
"""A user's descriptors in flight are limited (unix(7), ETOOMANYREFS): frozen readers use them up, new readers wait
until there are fewer. No connection is closed."""
from __future__ import annotations

import contextlib
import os
import pathlib
import signal
from collections.abc import Iterator

import pytest

from .programs import ROOT, Desk, Process, make_clip, result, stop, wait_until

pytestmark = pytest.mark.retry

FRAMES = 50
LIMIT = 256    # open descriptors, and descriptors in flight
STOPPED = 8    # readers
LATECOMER = 40 # frames kept for the last reader: each a new slot, announced to all
STORE = """\
#!/bin/sh
[ "$(id -u)" != 0 ] || drop="setpriv --bounding-set=-sys_resource,-sys_admin"
exec $drop prlimit --nofile={limit}:{limit} {store} "$@"
"""


@pytest.fixture
def desk(tmp_path: pathlib.Path) -> Iterator[Desk]:
    """A desk with a store without root's privileges, so that the limit holds as in the appliance."""
    store = tmp_path / "store"
    store.write_text(STORE.format(limit=LIMIT, store=ROOT / "bin/ddxstore"))
    store.chmod(0o755)
    desk = Desk(tmp_path, store=store)
    yield desk
    desk.end()


def connections(store: Process) -> set[str]:
    found = set()
    for path in pathlib.Path(f"/proc/{store.pid}/fd").iterdir():
        with contextlib.suppress(FileNotFoundError):  # closed by now
            found.add(os.readlink(path))
    return {link for link in found if link.startswith("socket:")}


def test_no_reader_is_disconnected_when_others_do_not_read(desk: Desk) -> None:
    clip = make_clip(desk.folder / "clip.y4m", "64x48", "100", FRAMES)
    loader = desk.start("ddxvideoload", clip, "-readers", STOPPED + 1)
    wait_until(lambda: bool(desk.item("video")))
    watchers = [desk.start("ddxctl", "watch", "video", "-json") for _ in range(STOPPED)]
    wait_until(lambda: desk.readers("video") == STOPPED)
    for watcher in watchers:
        watcher.send_signal(signal.SIGSTOP)
    before, room = connections(desk.store), desk.item("video")["reserved"]
    before &= connections(desk.store)  # without short-lived readers
    saver = desk.start("ddxvideosave", "-output", "/dev/null", "-keep", LATECOMER)
    wait_until(lambda: bool(desk.item("video")["reserved"] > room))  # all have been notified, or soon will be
    assert before - connections(desk.store) == set(), desk.errors(desk.store)
    for watcher in watchers:
        watcher.send_signal(signal.SIGCONT)
    assert result(loader)[1]["out"] == FRAMES
    assert len(before & connections(desk.store)) >= STOPPED  # the loader has closed its own
    status, saved = stop(saver)
    assert (status, saved["in"], saved["out"]) == (0, FRAMES, FRAMES), desk.errors(saver)
