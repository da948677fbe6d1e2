# SPDX-License-Identifier: GPL-2.0-or-later
"""WebKitGTK's MiniBrowser with one page, on its own display, in which expressions are evaluated through WebDriver."""
import base64
import json
import os
import pathlib
import sys
from collections.abc import Sequence
from typing import Any

from parts.common import MORTAL, Failed
from parts.media.display import Display
from parts.processes import Client

PROGRAM, PACKAGE = "WebKitWebDriver", "webkit2gtk-driver"
BROWSER = "/usr/lib/x86_64-linux-gnu/webkit2gtk-4.1/MiniBrowser"
PORT = "4455"
# Its bar with buttons is wider than a phone, if GTK is not told otherwise.
NARROW = "* { padding: 0; margin: 0; min-width: 0; border: 0; font-size: 1px; -gtk-icon-transform: scale(0.1); }\n"
# The driver listens in the machine's network: starts it, and passes requests on. Each is a line of JSON: method, path,
# body; so is the answer: status and value.
DRIVE = """
import http.client, json, subprocess, sys, time
driver = subprocess.Popen([sys.argv[1], "--host=127.0.0.1", "--port=" + sys.argv[2]], stdin=subprocess.DEVNULL,
                          stdout=sys.stderr)
for line in sys.stdin:
    method, path, body = json.loads(line)
    link = http.client.HTTPConnection("127.0.0.1", int(sys.argv[2]), timeout=300)
    while driver.poll() is None:
        try:
            link.connect()
            break
        except ConnectionRefusedError:
            time.sleep(0.1)
    link.request(method, path, None if body is None else json.dumps(body), {"Content-Type": "application/json"})
    answer = link.getresponse()
    print(json.dumps([answer.status, json.loads(answer.read())["value"]]), flush=True)
"""
# The browser does not exit with its driver; with the first of its processes, all do.
TOGETHER = ("unshare", "--pid", "--mount-proc", "--fork", "--kill-child")
EVALUATE = """const done = arguments[arguments.length - 1];
(async () => ({}))().then((value) => done([value === undefined ? null : value]), (error) => done(String(error)));"""


class WebKit:
    """As parts.media.browser.Browser. It takes any certificate."""

    def __init__(self, inside: Sequence[str], folder: pathlib.Path) -> None:
        (folder / "gtk-3.0").mkdir(parents=True)
        (folder / "gtk-3.0/gtk.css").write_text(NARROW)
        self.display, self.errors = Display("3840x2160"), folder / "errors"
        own = {name: str(folder) for name in ("HOME", "XDG_CONFIG_HOME", "XDG_RUNTIME_DIR")}
        with self.errors.open("w") as errors:
            command = [*MORTAL, *inside, *TOGETHER, sys.executable, "-c", DRIVE, PROGRAM, PORT]
            self.driver = Client(command, stderr=errors, env={**os.environ, **own, "DISPLAY": self.display.name})
        self.process, self.session = self.driver.process, "/session"
        options = {"binary": BROWSER, "args": ["--automation"]}
        made = self._order("POST", "", {"capabilities": {"alwaysMatch": {
            "acceptInsecureCerts": True, "webkitgtk:browserOptions": options}}})
        self.session = f"/session/{made['sessionId']}"

    def _order(self, method: str, path: str, body: object = None) -> Any:
        status, value = self.driver.ask(json.dumps([method, self.session + path, body]))
        if status != 200:
            raise Failed(f"{PROGRAM}: {path}: {value}")
        return value

    def visit(self, address: str) -> None:
        self._order("POST", "/url", {"url": address})

    def screen(self, width: int, height: int) -> None:
        self._order("POST", "/window/rect", {"x": 0, "y": 0, "width": width, "height": height})

    def picture(self, path: pathlib.Path) -> None:
        path.write_bytes(base64.b64decode(self._order("GET", "/screenshot")))

    def value(self, expression: str) -> Any:
        found = self._order("POST", "/execute/async", {"script": EVALUATE.replace("{}", expression), "args": []})
        if isinstance(found, str):
            raise Failed(f"{PROGRAM}: {expression[:60]}: {found}")
        return found[0]

    def end(self) -> None:
        self.driver.end()
        self.display.end()
