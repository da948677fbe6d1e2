# SPDX-License-Identifier: GPL-2.0-or-later
"""The panel's parts and the machine's services are killed, and /data is full or lost: the page shows that to a visitor,
and works again."""
from __future__ import annotations

import json
import pathlib
import subprocess
import sys
import time
from collections.abc import Iterator

import pytest

from lib.figures import Figure
from parts.common import MORTAL
from parts.guest import panel
from parts.guest.native_machine import NativeMachine
from parts.guest.panel import Visitor
from parts.processes import Client

pytestmark = [pytest.mark.retry, pytest.mark.long]

# For each line of standard input: asks until the panel answers, and prints the seconds.
ASKS = """
import http.client, ssl, sys, time
context = ssl._create_unverified_context()
for line in sys.stdin:
    begin = time.monotonic()
    while True:
        link = http.client.HTTPSConnection("127.0.0.1", context=context, timeout=60)
        try:
            link.request("GET", "/panel/session")
            if link.getresponse().status == 401:
                break
        except (OSError, http.client.HTTPException):
            time.sleep(0.02)
        link.close()
    print(time.monotonic() - begin, flush=True)
"""
MAIN = "$(cat /run/service/ddxpanel/supervise/pid)"
PARTS = {"the web server": "$(pgrep lighttpd)", "the web process": f"$(pgrep -P {MAIN} ddxpanel)",
         "root's process": MAIN}
OVER = "Log in again: the session is over."
LOG = "ddxlog"


def test_each_part_that_is_killed_is_back(root: pathlib.Path, tmp_path: pathlib.Path, record_property: Figure) -> None:
    with panel.filming(root, tmp_path / "machine") as robot, Visitor(
            robot, tmp_path / "browser", panel.certificate(robot)) as visitor:
        client = Client([*MORTAL, *panel.inside(robot), sys.executable, "-c", ASKS])
        client.ask()
        visitor.open()
        visitor.enters("services")
        for number, (name, process) in enumerate(PARTS.items(), 1):
            visitor.sees("document.querySelector('#service-ddxpanel')")
            robot.sh(f"kill -9 {process}")
            record_property(f"{name}: back after s", round(client.ask(), 2))
            robot.wait_until(f"ddxctl status ddxpanel | grep -q 'state=running .*restarts={number}$'")
            visitor.reads(OVER)
            visitor.enters("services")
        client.end()
        # The program that makes pictures: the page goes on with another one.
        visitor.taps("document.querySelector('a[href=\"#picture\"]')")
        for _ in range(3):
            visitor.sees("!document.querySelector('figure.old') && document.getElementById('picture').dataset.frame")
            frame, begin = visitor.browser.value("document.getElementById('picture').dataset.frame"), time.monotonic()
            robot.sh("kill -9 $(pgrep ddxvideosnap)")
            visitor.sees(f"Number(document.getElementById('picture').dataset.frame) > {frame} + 50")
            record_property("ddxvideosnap: 2 s of pictures later after s", round(time.monotonic() - begin, 2))
        assert "restarts=3" in robot.sh("ddxctl status ddxpanel")


def services(robot: NativeMachine) -> list[dict[str, object]]:
    return [json.loads(line) for line in robot.sh("ddxctl services --json").splitlines()]


def test_each_service_that_is_killed_is_shown(root: pathlib.Path, tmp_path: pathlib.Path,
                                              record_property: Figure) -> None:
    with panel.filming(root, tmp_path / "machine") as robot, Visitor(
            robot, tmp_path / "browser", panel.certificate(robot)) as visitor:
        for name in ("ddxvideosend", "ddxcatalog", LOG):
            robot.sh(f"ddxctl enable {name}")
            robot.wait_until(f"ddxctl status {name} | grep -q state=running")
        visitor.open()
        visitor.enters("services")
        killed = [one for one in services(robot) if one["state"] == "running" and one["name"] != "ddxpanel"]
        assert {"ddxstore", "ddxvideoload", "ddxvideosave", "ddxhealth", LOG} <= {one["name"] for one in killed}
        for name in [str(one["name"]) for one in killed]:
            card = f"document.getElementById('service-{name}')"
            visitor.sees(f"{card} && {card}.innerText.includes('running')")
            begin = time.monotonic()
            robot.sh(f"kill -9 {robot.sh(f'cat /run/service/{name}/supervise/pid')}")
            robot.wait_until(f"ddxctl status {name} | grep -q 'state=running .*restarts=[1-9]'", pause=0.02)
            back = time.monotonic() - begin
            visitor.sees(f"/running, started again [1-9]/.test({card}.innerText)")
            record_property(name, {"back_s": round(back, 2), "shown_s": round(time.monotonic() - begin, 2)})
        # Health has it as well, with what a technician can do.
        visitor.taps("document.querySelector('a[href=\"#health\"]')")
        visitor.reads("had to be started again")


@pytest.fixture
def keep(tmp_path: pathlib.Path) -> Iterator[pathlib.Path]:
    """With a small /data."""
    folder = tmp_path / "machine"
    (folder / "data").mkdir(parents=True)
    done = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=40m", "none", folder / "data"], capture_output=True,
                          text=True, check=False)
    if done.returncode:
        pytest.skip(f"cannot mount a small file system: {done.stderr.strip()}")
    yield folder
    subprocess.run(["umount", "-l", folder / "data"], check=True)


def refuses(robot: NativeMachine, visitor: Visitor, reason: str) -> None:
    """A service cannot be switched, and the page shows the reason."""
    switch = f"document.querySelector('#service-{LOG} [role=switch]')"
    visitor.open(f"{panel.ADDRESS}?{time.monotonic_ns()}#services")
    visitor.sees(switch)
    visitor.taps(switch)
    visitor.reads(reason)
    visitor.sees(f"{switch}.getAttribute('aria-checked') === 'false'")
    visitor.taps("document.querySelector('a[href=\"#health\"]')")


def restarted(robot: NativeMachine, count: int) -> None:
    robot.sh("ddxctl restart ddxpanel")
    robot.wait_until(f"[ $(ddxctl logs ddxpanel | grep -c ready) = {count} ]")


def test_data_is_full_and_then_lost(root: pathlib.Path, tmp_path: pathlib.Path, keep: pathlib.Path) -> None:
    with panel.filming(root, keep) as robot:
        robot.sh("mkdir -p /run/settings; echo enabled=yes > /run/settings/ddxpanel.conf")  # as by ddx.txt
        shown = panel.certificate(robot)
        robot.run("dd if=/dev/zero of=/data/fill bs=4096")
        restarted(robot, 2)
        assert panel.certificate(robot) == shown  # it is there already
        with Visitor(robot, tmp_path / "first", shown) as visitor:
            visitor.open()
            visitor.enters("services")
            refuses(robot, visitor, f"/data/ddx/{LOG}.conf: cannot be written; is /data full?")
            visitor.sees("[...document.querySelectorAll('.complaint')].some((one) => /\\/data: 0 of 40 MB free/"
                         ".test(one.innerText) && one.querySelector('.action'))")
        # No room for a certificate: a temporary one.
        robot.run("rm -r /data/panel; dd if=/dev/zero of=/data/more bs=64")
        restarted(robot, 3)
        temporary = panel.certificate(robot)
        assert temporary != shown and "the certificate is a temporary one" in robot.sh("ddxctl logs ddxpanel")
        assert panel.digest(temporary) in robot.sh("ddxctl panel")
        robot.sh("umount -l /data")
        restarted(robot, 4)
        with Visitor(robot, tmp_path / "second", panel.certificate(robot)) as visitor:
            visitor.open()
            visitor.enters("services")
            refuses(robot, visitor, "/data, where settings are kept, is not mounted")
            visitor.sees("[...document.querySelectorAll('.complaint')].some((one) => /\\/data is not mounted/"
                         ".test(one.innerText) && one.querySelector('.action'))")
        assert "restarts=0" in robot.sh("ddxctl status ddxpanel")
