# SPDX-License-Identifier: GPL-2.0-or-later
"""Each command of docs/technician.md, sections 3 to 8, but for keys, is done by a visitor of the panel on a screen 360
pixels wide, in the page's order, by taps on elements of the screen; the panel's log has the order."""
from __future__ import annotations

import json
import pathlib
import re
from collections.abc import Callable

import pytest

import docs
from parts.common import Failed, wait_until
from parts.guest import panel
from parts.guest.native_machine import NativeMachine
from parts.guest.panel import PASSPHRASE, Visitor

pytestmark = pytest.mark.retry

SECTIONS = range(3, 9)
LEAST = 32  # pixels, of what a finger taps
# Scrolls there, and taps what is in the middle of it then; what is wrong, if that is something else.
TAP = """(() => {
    const one = {};
    if (!one) return "there is no such button";
    if (one.closest("details > :not(summary)")) one.closest("details").open = true;
    one.scrollIntoView({ block: "center", behavior: "instant" });
    const { left, right, top, bottom } = one.getBoundingClientRect();
    const found = document.elementFromPoint((left + right) / 2, (top + bottom) / 2);
    if (left < 0 || right > innerWidth || bottom - top < LEAST) return `${left} to ${right}, ${bottom - top} high`;
    if (found !== one && !one.contains(found)) return `covered by ${found && found.outerHTML}`;
    found.click();
    return "";
})()""".replace("LEAST", str(LEAST))


class Technician:
    def __init__(self, robot: NativeMachine, visitor: Visitor) -> None:
        self.robot, self.visitor = robot, visitor

    def tap(self, expression: str) -> None:
        said = ""

        def tapped() -> bool:
            nonlocal said
            said = str(self.visitor.browser.value(TAP.replace("{}", expression, 1)))
            return not said

        self.visitor.sees(expression)
        try:
            wait_until(tapped, f"{expression} cannot be tapped", 0.2, panel.SHOWN)
        except Failed as error:
            raise Failed(f"{error}: {said}") from None

    def button(self, text: str, card: str = "") -> str:
        """The first button that begins with this text; on a card, if one is named."""
        place = f"#{card} button, #{card} a.button, #{card} [role=switch]" if card else "main button, main a.button"
        return (f"[...document.querySelectorAll({json.dumps(place)})].find((one) => "
                f"one.textContent.startsWith({json.dumps(text)}))")

    def page(self, name: str) -> None:
        self.tap(f"document.querySelector('nav a[href=\"#{name}\"]')")
        self.visitor.sees("document.querySelector('nav a[aria-current]')"
                          f".hash === '#{name}' && !document.body.innerText.includes('Loading ...')")

    def agrees(self, text: str, card: str = "", consequence: str = "") -> None:
        """Both taps on a button that switches something off."""
        self.tap(self.button(text, card))
        self.tap(self.button(consequence or text, card))

    def ordered(self, words: str, status: int = 0) -> None:
        """The machine has executed it, as the panel's log says."""
        self.robot.wait_until(f"ddxctl logs ddxpanel | grep -q 'session 1: {words}: exit status {status}$'")

    # ---- The page's commands ----

    def health(self) -> None:
        self.page("health")
        self.visitor.reads("checked now")
        self.ordered("health", self.robot.run("ddxctl health")[0])

    def services(self) -> None:
        self.page("services")
        for line in self.robot.sh("ddxctl services --json").splitlines():
            self.visitor.sees(f"document.getElementById('service-{json.loads(line)['name']}')")

    def enable(self) -> None:
        self.page("services")
        self.tap("document.querySelector('#service-ddxvideosend [aria-checked=false]')")
        self.ordered("enable ddxvideosend")

    def disable(self) -> None:
        self.page("services")
        self.agrees("On", "service-ddxvideosend", "Switch off")
        self.ordered("disable ddxvideosend")

    def status(self) -> None:
        self.page("services")
        self.visitor.sees("document.getElementById('service-ddxvideosave').innerText.includes('running')")

    def logs(self) -> None:
        self.page("services")
        self.tap(self.button("Messages", "service-ddxvideosave"))
        last = self.robot.sh("ddxctl logs ddxvideosave").splitlines()[0]
        self.visitor.reads(last)
        self.ordered("logs ddxvideosave")

    def recordings(self) -> None:
        self.page("recordings")
        self.visitor.sees(f"document.getElementById('recording-{self.finished()}')")

    def finished(self) -> str:
        lines = [json.loads(line) for line in self.robot.sh("ddxctl recordings list --json").splitlines()]
        return str([one["recording"] for one in lines if one["state"] == "finished"][-1])

    def export(self) -> None:
        """Begun; there is no stick."""
        self.page("recordings")
        self.tap(self.button("Copy to stick", f"recording-{self.finished()}"))
        self.visitor.reads("no USB stick is plugged in")
        self.ordered(f"recordings copy {self.finished()} usb")

    def verify(self) -> None:
        self.page("recordings")
        self.tap(self.button("Verify all"))
        self.visitor.reads("verify all: good.")
        self.ordered("recordings verify")

    def remove_recording(self) -> None:
        self.page("recordings")
        name = self.finished()
        self.agrees("Delete", f"recording-{name}")
        self.ordered(f"recordings remove {name}")

    def stream(self, name: str = "ddxvideosend") -> None:
        self.page("streams")
        self.tap(self.button("File for players", re.sub(r"([.])", r"\\\1", f"stream-{name}")))
        self.visitor.reads(f"Save {name}.sdp")
        self.ordered(f"stream {name}")

    def add(self, name: str, **fields: str) -> None:
        self.page("streams")
        if not self.visitor.browser.value("document.getElementById('add-stream').open"):
            self.tap("document.querySelector('#add-stream summary')")
        for field, text in {"name": name, "port": "8000", "ts": "", "to": "", **fields}.items():
            self.visitor.browser.value(f"document.getElementById('stream-{field}').value = '{text}'")
        self.tap("document.querySelector('#add-stream button')")
        self.visitor.sees(f"document.getElementById('stream-ddxvideosend.{name}')")

    def add_vlc(self) -> None:
        self.add("vlc", port="8010", ts="8100")
        self.ordered("add ddxvideosend.vlc name=video port=8010 ts=8100")

    def add_laptop(self) -> None:
        self.add("laptop", to="192.168.0.20")
        self.ordered("add ddxvideosend.laptop name=video group=none to=192.168.0.20 port=8000")

    def remove(self, name: str) -> None:
        self.page("streams")
        self.agrees("Remove", f"stream-ddxvideosend\\.{name}")
        self.ordered(f"remove ddxvideosend.{name}")

    def reset(self) -> None:
        self.page("machine")
        self.agrees("Reset settings", "", "Reset: all switching")
        self.robot.wait_until("! ls /data/ddx/*.conf")

    def power_off(self) -> None:
        """With the settings that were reset the panel is off, without a line in ddx.txt; here it has one."""
        self.visitor.open(f"{panel.ADDRESS}?again#machine")
        self.visitor.sees("document.getElementById('passphrase')")
        self.visitor.logs_in(PASSPHRASE)
        self.agrees("Power off")
        self.robot.wait_for_end()


WAYS: dict[str, Callable[[Technician], None]] = {
    "ddxctl health": Technician.health,
    "ddxctl services": Technician.services,
    "ddxctl enable ddxvideosend": Technician.enable,
    "ddxctl disable ddxvideosend": Technician.disable,
    "ddxctl status ddxvideosave": Technician.status,
    "ddxctl logs ddxvideosave": Technician.logs,
    "ddxctl recordings": Technician.recordings,
    "ddxctl recordings export newest usb": Technician.export,
    "ddxctl recordings verify": Technician.verify,
    "ddxctl recordings remove video-000012": Technician.remove_recording,
    "ddxctl stream": Technician.stream,
    "ddxctl add ddxvideosend.vlc port=8010 ts=8100": Technician.add_vlc,
    "ddxctl add ddxvideosend.laptop group=none to=192.168.0.20": Technician.add_laptop,
    "ddxctl stream ddxvideosend.laptop": lambda one: one.stream("ddxvideosend.laptop"),
    "ddxctl remove ddxvideosend.laptop": lambda one: one.remove("laptop"),
    "ddxctl remove ddxvideosend.vlc": lambda one: one.remove("vlc"),
    "ddxctl reset settings": Technician.reset,
    "poweroff": Technician.power_off,
}


def typed() -> list[str]:
    """The commands of these sections, without those of the encrypted stream."""
    text = re.sub(r"^### An encrypted stream$.*?(?=^## )", "", docs.PAGE.read_text(), flags=re.M | re.S)
    found = []
    for section in re.split(r"^## ", text, flags=re.M):
        number = re.match(r"(\d+)\. ", section)
        if number and int(number[1]) in SECTIONS:
            found += [command for machine, command in docs.PROMPT.findall(section) if machine == docs.ROBOT]
    return found


def test_each_command_has_a_way_on_a_page() -> None:
    assert len(typed()) > 15 and set(typed()) == set(WAYS)


@pytest.mark.long
def test_each_command_on_a_phone(root: pathlib.Path, tmp_path: pathlib.Path) -> None:
    with panel.filming(root, tmp_path / "machine") as robot, Visitor(
            robot, tmp_path / "browser", panel.certificate(robot)) as visitor:
        robot.sh("mkdir -p /run/settings; echo enabled=yes > /run/settings/ddxpanel.conf")  # as with a line in ddx.txt
        robot.wait_until("ddxctl recordings | grep -q ' recording$'")
        robot.sh("ddxctl record split")
        visitor.open()
        visitor.sees("document.getElementById('passphrase')")
        visitor.browser.screen(*docs.PHONE)
        visitor.logs_in(PASSPHRASE)
        visitor.sees("document.querySelector('nav a[aria-current]')")
        technician = Technician(robot, visitor)
        for command in typed():
            WAYS[command](technician)
