# SPDX-License-Identifier: GPL-2.0-or-later
"""The panel's page of streams, in Chromium: one to the visitor's device, one of the form; then a reset."""
from __future__ import annotations

import pathlib

import pytest

from parts.guest import panel
from parts.guest.panel import Visitor

pytestmark = pytest.mark.retry

# Keeps the file that the page offers: its policy does not let scripts fetch it.
KEEP = "{ const make = URL.createObjectURL; URL.createObjectURL = (blob) => make(globalThis.kept = blob); }"
MINE = "ddxvideosend.to-127-0-0-1"
LONGEST = "fd12:3456:789a:bcde:f012:3456:789a:bcde"


def button(name: str, text: str) -> str:
    """The button of a stream's card that begins with this text."""
    return (f"[...document.querySelectorAll('[id=\"stream-{name}\"] button')]"
            f".find((one) => one.textContent.startsWith('{text}'))")


def test_streams_come_and_go(root: pathlib.Path, tmp_path: pathlib.Path) -> None:
    with panel.filming(root, tmp_path / "machine") as robot, Visitor(
            robot, tmp_path / "browser", panel.certificate(robot)) as visitor:
        settings = robot.keep / "data/ddx"
        visitor.open()
        visitor.enters("streams")
        visitor.sees(button("ddxvideosend", "Switch on"))
        assert visitor.browser.value(f"{button('ddxvideosend', 'Remove')} === undefined")
        visitor.browser.value(KEEP)
        visitor.taps("document.getElementById('watch')")
        visitor.reads(f"Save {MINE}.sdp")
        assert (settings / f"{MINE}.conf").read_text().splitlines() == ["enabled=yes", "group=none", "to=127.0.0.1"]
        said = str(visitor.browser.value("kept.text()"))
        assert said.split("\r\n") == [*robot.sh(f"ddxctl stream {MINE}").splitlines(), ""]
        visitor.reads("to 127.0.0.1, port 8000")
        robot.wait_until(f"ddxctl stats --json | grep '\"{MINE}\"' | grep -q '\"out\":[1-9]'")
        # Again: the same stream.
        visitor.open(f"{panel.ADDRESS}?again#streams")
        visitor.sees(button(MINE, "Remove"))
        visitor.taps("document.getElementById('watch')")
        visitor.reads(f"Save {MINE}.sdp")
        visitor.taps(button(MINE, "Remove"))
        visitor.reads(f"Remove {MINE}: its viewers see nothing")
        assert (settings / f"{MINE}.conf").exists()
        visitor.agrees(button(MINE, "Remove"))
        visitor.sees(f"!document.getElementById('stream-{MINE}')")
        assert not (settings / f"{MINE}.conf").exists()
        # The form.
        visitor.taps("document.querySelector('#add-stream summary')")
        for name, value in (("name", "vlc"), ("item", "late"), ("port", "8010"), ("ts", "8100")):
            visitor.browser.value(f"document.getElementById('stream-{name}').value = '{value}'")
        visitor.taps("document.querySelector('#add-stream button')")
        visitor.sees(button("ddxvideosend.vlc", "File for players"))
        assert (settings / "ddxvideosend.vlc.conf").read_text().splitlines() == [
            "enabled=yes", "name=late", "port=8010", "ts=8100"]
        # An item without pictures: the page asks until there is one.
        visitor.taps(button("ddxvideosend.vlc", "File for players"))
        visitor.reads("ddxvideosend.vlc has sent no picture yet")
        robot.sh("ddxvideoload /test/clip.y4m -rate 0 -name late -instance late")
        visitor.reads("Save ddxvideosend.vlc.sdp")
        visitor.browser.value("document.getElementById('stream-name').value = 'odd'")
        visitor.browser.value("document.getElementById('stream-to').value = 'nowhere'")
        visitor.taps("document.querySelector('#add-stream button')")
        visitor.sees("/^(?!add ).*nowhere/.test(document.getElementById('notice').textContent)")
        assert not (settings / "ddxvideosend.odd.conf").exists()
        # The page goes away with its settings, and comes back with those of ddx.txt.
        robot.sh("mkdir -p /run/settings; echo enabled=yes > /run/settings/ddxpanel.conf")
        visitor.taps("document.querySelector('a[href=\"#machine\"]')")
        visitor.sees("document.getElementById('reset')")
        visitor.taps("document.getElementById('reset')")
        visitor.reads("Reset: all switching and added streams are undone")
        assert (settings / "ddxvideosend.vlc.conf").exists()
        visitor.agrees("document.getElementById('reset')")
        robot.wait_until("! ls /data/ddx/*.conf")
        robot.wait_until("[ $(ddxctl logs ddxpanel | grep -c ready) = 2 ]")
        robot.wait_until("! ddxctl services | grep -q vlc")


@pytest.mark.long
def test_a_visitor_with_the_longest_address(root: pathlib.Path, tmp_path: pathlib.Path) -> None:
    """The name of its stream is as long as names of instances may be."""
    with panel.filming(root, tmp_path / "machine") as robot, Visitor(
            robot, tmp_path / "browser", panel.certificate(robot)) as visitor:
        robot.sh(f"ip addr add {LONGEST}/128 dev lo")
        visitor.open(f"https://[{LONGEST}]/")
        visitor.enters("streams")
        visitor.sees(button("ddxvideosend", "Switch on"))
        visitor.taps("document.getElementById('watch')")
        name = "ddxvideosend.to" + LONGEST.replace(":", "-")
        visitor.reads(f"Save {name}.sdp")
        assert f"to={LONGEST}" in (robot.keep / f"data/ddx/{name}.conf").read_text().splitlines()
