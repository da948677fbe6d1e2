# SPDX-License-Identifier: GPL-2.0-or-later
"""A stream in the image, from the store through the network to ddxdecode, while the recorder runs."""
import json
import pathlib
import re

import pytest

from parts.guest import qemu, session, testdisk
from parts.media import clip as default_clip

pytestmark = pytest.mark.strict

SECONDS = 8
FRAMES = SECONDS * default_clip.RATE


def test_the_sender_is_off_by_default(guest: qemu.Guest) -> None:
    code, text = guest.shell().run("/etc/init.d/S*ddxvideosend status")
    assert code == 3 and "enabled=no state=stopped" in text


def test_stream(boot: qemu.Boot, work: pathlib.Path) -> None:
    """Each frame shown has the number that ddxdecode prints. MPEG-4: an emulated processor is too slow for H.264."""
    clip = work / "stream.y4m"
    default_clip.write(clip, SECONDS)
    settings = {"ddxvideosend.conf": "enabled=yes\ncodec=mpeg4\ninterface=lo\n", "ddxvideoload.conf": "readers=3\n"}
    with boot("stream", test_disk=testdisk.make(work / "stream.img", clip, settings)) as guest:
        guest.shell()
        guest.sh("ddxdecode -headless -interface lo -print > /tmp/shown 2> /tmp/said &")
        guest.wait_until("netstat -uln | grep -q :8000", pause=0.1)
        # The clip begins with the third reader, after recorder and sender. The loader may not have made the item yet.
        guest.sh("until ddxctl watch video; do sleep 0.1; done > /dev/null 2>&1 &")
        session.wait_for_clip(guest, FRAMES)
        sent = f"\"ddxvideosend\",\"in\":{FRAMES},\"out\":[0-9]*,\"waiting\":0"
        guest.wait_until(f"ddxctl stats --json | grep -q '{sent}'")
        guest.sh("kill $(pidof ddxdecode)")
        guest.wait_until("! pidof ddxdecode", pause=0.1)
        shown = guest.sh("cat /tmp/shown")
        said = guest.sh("cat /tmp/said /run/log/ddxvideosend/current")
        session.stop_recorder(guest)
        result = session.collect(guest, clip, work / "stream-recorded.y4m")
    assert result.good, result.disagreements  # the recording is not affected
    *lines, packets, frames = shown.splitlines()
    counters, frame_counters = json.loads(packets), json.loads(frames)
    numbers = [int(match[1]) for line in lines if (match := re.match(r"frame (\d+) ", line))]
    assert numbers and numbers == sorted(set(numbers)), said
    assert counters["lost"] == counters["garbage"] == 0
    assert frame_counters["in"] == frame_counters["out"] + sum(frame_counters["lost"].values())
    print(f"{len(numbers)} of {FRAMES} frames shown, {frame_counters}")
