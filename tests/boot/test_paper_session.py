# SPDX-License-Identifier: GPL-2.0-or-later
"""The paper's example session, except ddxlog, typed into a shell of the image."""
import json
import re
import time

import pytest

from lib.seen import Seen, ppm
from parts.common import PATIENCE
from parts.guest import qemu

from . import camera

pytestmark = [pytest.mark.retry, pytest.mark.long]

RECORDED = 15


def frame_after(guest: qemu.Guest, other: int) -> int:
    """Wait until the viewer shows a frame newer than `other`; return its number."""
    deadline = time.monotonic() + PATIENCE
    while (found := Seen(ppm(guest.screen())).frame() or 0) <= other:
        assert time.monotonic() < deadline, guest.sh("cat /tmp/viewed")
    return found


def test_the_paper_s_session(boot: qemu.Boot) -> None:
    network = ("-netdev", "user,id=net,restrict=on", "-device", "virtio-net-pci,netdev=net")
    with boot("session", more_memory=128, extra=network) as guest:
        guest.shell()
        guest.sh("for name in ddxvideoV4L ddxvideosave store; do /etc/init.d/S*$name stop; done; cd /tmp")
        guest.sh("ip link set eth0 up && ip addr add 10.0.0.1/24 dev eth0 && ip route add default via 10.0.0.2")
        guest.sh("modprobe vivid n_devs=3 node_types=0x1,0x1,0x1")
        guest.wait_until("[ -c /dev/video2 ]")

        guest.sh("{ catalog & } > /tmp/linked 2>&1; store -m 8M & sleep 1")
        guest.sh("ddxvideoV4L -camera 2 -skip 5 -size CIF -name video &")
        guest.sh("ddxvideosave -name video -output /tmp/test.y4m &")
        guest.sh("{ ddxvideoview -name video; echo status $?; } > /tmp/viewed 2>&1 &")
        guest.sh("ddxvideosend -port 8000 &")
        guest.sh("decode > /tmp/decoded 2>&1 &")
        camera.wait_for_frames(guest, RECORDED, "ddxvideosave")
        camera.wait_for_frames(guest, 5, "ddxdecode")
        guest.wait_until("[ -e /run/late.done ]")  # the display's driver
        if guest.sh("[ -c /dev/dri/card0 ] && echo yes || echo no") == "yes":
            frame_after(guest, frame_after(guest, 0))
        else:  # a BIOS leaves the screen in text mode
            assert "no display: " in (viewed := guest.sh("cat /tmp/viewed")) and "status 1" in viewed
        guest.wait_until("ddxctl list | grep -q catalog.answer")
        guest.sh("killall decode ddxvideosend ddxvideosave ddxvideoV4L catalog; sleep 2")
        times = [int(word) for word in re.findall(r"XTIME=(\d+)", guest.sh("grep -ao 'XTIME=[0-9]*' /tmp/test.y4m"))]
        rate = re.search(r" F(\d+):(\d+) ", guest.sh("head -n 1 /tmp/test.y4m"))
        said = guest.sh("ddxvideoload /tmp/test.y4m")
        decoded = guest.sh("cat /tmp/decoded")
        linked = guest.sh("cat /tmp/linked")
    counters = json.loads(next(line for line in said.splitlines() if line.startswith("{")))
    assert counters["in"] == counters["out"] == len(times) >= RECORDED
    assert rate
    period = int(rate[2]) / int(rate[1]) * 1e9
    steps = [(after - before) / period for before, after in zip(times, times[1:])]
    assert all(abs(step - round(step)) < 0.3 for step in steps), steps  # every fifth of the camera's frames
    assert "going on without" in decoded and "receiving H.264" in decoded
    assert json.loads(linked.splitlines()[-1])["in"] == 0  # no other machine reads our items

