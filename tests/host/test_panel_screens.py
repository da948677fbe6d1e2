# SPDX-License-Identifier: GPL-2.0-or-later
"""Each page of the panel on a phone, a tablet and a large screen, in Chromium and in WebKit: nothing is cut, nothing
covers a button, and the page has no message of an error."""
from __future__ import annotations

import json
import pathlib

import pytest

from parts.guest import panel
from parts.guest.panel import PASSPHRASE, Visitor
from parts.media import webkit

from . import absent

pytestmark = [pytest.mark.retry, pytest.mark.long]

SCREENS = [(360, 640), (800, 600), (3840, 2100)]
# Each page with words that it shows when it is complete.
PAGES = {"health": "checked now", "services": "ddxhealth", "picture": "frame ", "recordings": "Copy to stick",
         "streams": "File for players", "messages/ddxpanel": "logged in", "report": "Make the report",
         "machine": "Power off"}
LONG = "ddxvideosend.tofd12-3456-789a-bcde-f012-3456-789a-bcde"  # of a visitor with IPv6
# Elements beyond the screen, elements without room for their text, and controls that cover each other.
WRONG = """(() => {
    for (const one of document.querySelectorAll("details")) one.open = true;
    const name = (one) => `${one.tagName} ${one.id} ${one.textContent.slice(0, 40)}`, wrong = [];
    const shown = (list) => [...document.querySelectorAll(list)].filter((one) => one.getClientRects().length);
    if (document.documentElement.scrollWidth > innerWidth) wrong.push(`page: ${document.documentElement.scrollWidth}`);
    for (const one of shown("header *, main *")) {
        const { left, right } = one.getBoundingClientRect();
        if (left < 0 || right > innerWidth + 0.5) wrong.push(`outside: ${name(one)}`);
        if (one.clientWidth && one.scrollWidth > one.clientWidth + 1) wrong.push(`cut: ${name(one)}`);
    }
    const controls = shown("button, input, select, a, summary").map((one) => [one, one.getBoundingClientRect()]);
    for (const [one, a] of controls)
        for (const [other, b] of controls)
            if (one !== other && a.left < b.right - 1 && b.left < a.right - 1 && a.top < b.bottom - 1
                && b.top < a.bottom - 1 && !one.closest("header") && !other.closest("header"))
                wrong.push(`covered: ${name(one)}, ${name(other)}`);
    return wrong;
})()"""


@pytest.mark.parametrize("browser", ["chromium", "webkit"])
def test_each_page_fits_each_screen(root: pathlib.Path, tmp_path: pathlib.Path, browser: str) -> None:
    if browser == "webkit":
        absent.need(webkit.PROGRAM, webkit.PACKAGE)
    with panel.filming(root, tmp_path / "machine") as robot:
        robot.wait_until("ddxctl recordings | grep -q ' recording$'")
        robot.sh(f"ddxctl record split; ddxctl add {LONG} group=none to=127.0.0.1 port=8004")
        robot.sh(f"mkdir -p /run/log/ddxpanel; echo {'0123456789' * 30} >> /run/log/ddxpanel/current")
        with Visitor(robot, tmp_path / "browser", panel.certificate(robot), browser == "webkit") as visitor:
            visitor.open()
            visitor.sees("document.getElementById('passphrase')")
            for width, height in SCREENS:
                visitor.browser.screen(width, height)
                visitor.sees(f"innerWidth === {width}")
                assert visitor.browser.value(WRONG) == [], (width, "login")
            visitor.logs_in(PASSPHRASE)
            visitor.sees("document.querySelector('a[href=\"#health\"]')")
            for width, height in SCREENS:
                visitor.browser.screen(width, height)
                visitor.sees(f"innerWidth === {width}")
                for name, words in PAGES.items():
                    visitor.browser.value(f"location.hash = {json.dumps(name)}")
                    visitor.sees(f"document.querySelector('nav a[aria-current]').hash === '#{name.split('/')[0]}'")
                    visitor.reads(words)
                    assert visitor.browser.value(WRONG) == [], (width, name)
                    assert visitor.browser.value("document.querySelectorAll('p.bad').length") == 0, (width, name)
                    visitor.browser.picture(tmp_path / f"{width}-{name.replace('/', '-')}.png")
