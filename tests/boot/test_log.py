# SPDX-License-Identifier: GPL-2.0-or-later
"""The logger in the image is off by default; switched on, it logs every value of a clip's items, readable by others."""
import pathlib

import pytest

from lib import logs
from parts.guest import qemu, session
from parts.media import clip as default_clip
from parts.media.recording import FileSystem

pytestmark = pytest.mark.strict

FRAMES = default_clip.RATE * default_clip.SHORT
RATE = 4  # speed factor
# The logger's count of written values.
OUT = "out=$(ddxctl stats --json | sed -n '/\"ddxlog\"/s/.*\"out\":\\([0-9]*\\).*/\\1/p');"


def test_a_clip_is_logged(guest: qemu.Guest, recorded: session.Result, work: pathlib.Path) -> None:
    assert "enabled=no state=stopped" in guest.shell().run("ddxctl status ddxlog")[1]
    guest.sh("ddxctl enable ddxlog")
    guest.wait_until("ddxctl status ddxlog | grep -q state=running")
    guest.wait_until("ddxctl list | grep -q ddxlog.stats")
    guest.wait_until(f"{OUT} [ -n \"$out\" ] && [ \"$out\" -ge 1 ]")  # it has found the existing items
    guest.sh("ddxctl set video.frame value=777")
    guest.sh(f"/usr/bin/ddxvideoload /test/clip.y4m -name second -instance second -readers 0 -rate {RATE}")
    guest.sh("sleep 2")
    stats = guest.sh("ddxctl stats --json | grep '\"ddxlog\"'")
    guest.sh("ddxctl disable ddxlog; rm /data/ddx/ddxlog.conf")
    names = guest.sh("echo /rec/log/*.mcap").split()
    assert len(names) == 1
    assert guest.sh(f"stat -c '%U %G' {names[0]}") == "ddxlogger ddx"
    guest.sh("sync")
    path = work / "fetched.mcap"
    FileSystem(guest.snapshot()).take(names[0].removeprefix("/rec/"), path)
    log = logs.read(path)
    frames = [one.value.value for one in log.values["second.frame"]]
    assert '"write":0' in stats and '"queue":0' in stats
    assert frames[-1] == FRAMES - 1 and frames == sorted(set(frames))
    record = [one.value for one in log.values["ddxlog/lost"] if one.value["item"] == "second.frame"][-1]
    assert record["in"] == FRAMES == record["out"] + sum(record["lost"].values()) and record["out"] == len(frames)
    assert [one.value.value for one in log.values["video.frame"]] == [FRAMES - 1, 777]
    assert "second" not in log.values and "second.parameters" in log.values  # pictures are not logged
