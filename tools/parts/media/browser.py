# SPDX-License-Identifier: GPL-2.0-or-later
"""A headless Chromium with one page, in which expressions are evaluated through the debugging pipe."""
import base64
import json
import os
import pathlib
import subprocess
import time
from collections.abc import Sequence
from typing import Any

from parts.common import MORTAL, Failed, wait_until

PROGRAM = "chromium"
# Chromium does not run as root with its sandbox.
OPTIONS = ["--headless=new", "--no-sandbox", "--no-first-run", "--disable-gpu", "--disable-background-networking",
           "--disable-component-update", "--disable-background-timer-throttling", "--disable-renderer-backgrounding",
           "--disable-dev-shm-usage", "--mute-audio", "--remote-debugging-pipe"]
# The pipe is at descriptors 3 and 4.
PIPED = ["sh", "-c", 'exec "$@" 3<&0 4>&1 < /dev/null > /dev/null', "sh"]
PIECE = 1 << 20


class Browser:
    """`folder` is created for Chromium's files. `inside`: words before the command, to enter a namespace."""

    def __init__(self, inside: Sequence[str], folder: pathlib.Path, *options: str) -> None:
        folder.mkdir()
        self.errors = folder / "errors"
        words = [PROGRAM, *OPTIONS, f"--user-data-dir={folder}", *options]
        with self.errors.open("w") as errors:
            self.process = subprocess.Popen([*MORTAL, *inside, *PIPED, *words], stdin=subprocess.PIPE,
                                            stdout=subprocess.PIPE, stderr=errors)
        self.count, self.session, self.rest = 0, "", b""

    def open(self, page: pathlib.Path) -> None:
        """Open a file; the last line of its script defines `ready`."""
        self.visit(page.as_uri())
        wait_until(lambda: bool(self.value("typeof ready === 'boolean'")), f"{PROGRAM} does not open {page.name}")

    def visit(self, address: str) -> None:
        """Begin to load an address, in the page that is open already or in a first one."""
        if self.session:
            self._order("Page.navigate", url=address)
            return
        target = self._order("Target.createTarget", url=address)["targetId"]
        self.session = self._order("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]

    def screen(self, width: int, height: int, scheme: str = "light") -> None:
        """The screen of a phone with that many pixels; `scheme`: light or dark."""
        self._order("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=True)
        self._order("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])

    def slow(self, times: int) -> None:
        """Give the page's scripts and drawing so much less of a processor."""
        self._order("Emulation.setCPUThrottlingRate", rate=times)

    def picture(self, path: pathlib.Path) -> None:
        """Write what the screen shows, as PNG."""
        path.write_bytes(base64.b64decode(self._order("Page.captureScreenshot", format="png")["data"]))

    def _order(self, method: str, **parameters: object) -> Any:
        assert self.process.stdin
        self.count += 1
        order = {"id": self.count, "method": method, "params": parameters}
        order |= {"sessionId": self.session} if self.session else {}
        self.process.stdin.write(json.dumps(order).encode() + b"\0")
        self.process.stdin.flush()
        while (answer := self._read()).get("id") != self.count:
            pass  # an event
        if "error" in answer:
            raise Failed(f"{PROGRAM}: {method}: {answer['error']['message']}")
        return answer["result"]

    def _read(self) -> Any:
        assert self.process.stdout
        parts = [self.rest]
        while b"\0" not in parts[-1]:
            parts.append(os.read(self.process.stdout.fileno(), PIECE))
            if not parts[-1]:
                raise Failed(f"{PROGRAM} has stopped: {self.errors.read_text()[-500:]}")
        answer, _, self.rest = b"".join(parts).partition(b"\0")
        return json.loads(answer)

    def value(self, expression: str) -> Any:
        """The value of an expression in the page; of a promise, after it is fulfilled."""
        found = self._order("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in found:
            raise Failed(f"{PROGRAM}: {expression[:60]}: {found['exceptionDetails']['exception'].get('description')}")
        return found["result"].get("value")

    def clock(self) -> int:
        """CLOCK_MONOTONIC in ns when the page's clock, performance.now(), was 0."""
        found = []
        for _ in range(20):  # the fastest answer is the most precise
            before = time.monotonic_ns()
            page = self.value("performance.now()")
            after = time.monotonic_ns()
            found.append((after - before, (before + after) // 2 - int(page * 1e6)))
        return min(found)[1]

    def end(self) -> None:
        self.process.terminate()
        self.process.communicate(timeout=20)
