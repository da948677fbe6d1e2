# SPDX-License-Identifier: GPL-2.0-or-later
"""The panel's page of recordings, in Chromium, while the machine records."""
from __future__ import annotations

import hashlib
import json
import pathlib
import subprocess
import sys
from typing import Any

import pytest

from parts.common import MORTAL, Closing
from parts.guest import panel
from parts.guest.native_machine import NativeMachine
from parts.guest.panel import OWN, PASSPHRASE, Visitor
from parts.processes import kill

from .programs import lost
from .test_panel_picture import recorder

pytestmark = pytest.mark.retry

# Fetches a path of standard input (a line of JSON: path, headers, bytes to read at most), and prints status, headers,
# size and SHA-256; the connection is closed after those bytes.
FETCH = """
import hashlib, http.client, json, ssl, sys
path, headers, most = json.load(sys.stdin)
link = http.client.HTTPSConnection("127.0.0.1", context=ssl._create_unverified_context(), timeout=60)
link.request("GET", path, headers=headers)
answer = link.getresponse()
try:
    body = answer.read(most)
except http.client.IncompleteRead as error:
    body = b"incomplete"
print(json.dumps([answer.status, dict(answer.headers), len(body), hashlib.sha256(body).hexdigest()]))
"""
# Not the program that lists recordings for the page every few seconds.
VERIFIES = "$(pgrep -f '^[^ ]*ddxrecordings .*verify')"


def recordings(robot: NativeMachine) -> list[dict[str, Any]]:
    return [json.loads(line) for line in robot.sh("ddxctl recordings list --json").splitlines()]


def button(name: str, text: str) -> str:
    """The button of a recording's card that begins with this text."""
    return (f"[...document.querySelectorAll('[id=\"recording-{name}\"] button')]"
            f".find((one) => one.textContent.startsWith('{text}'))")


def large(robot: NativeMachine, frames: int) -> pathlib.Path:
    """A file of zeros, 6 MiB a frame, that takes no room on a disk."""
    with (robot.keep / "rec" / LARGE).open("wb") as file:
        file.write(b"YUV4MPEG2 W%d H%d F25:1\n" % (SIDE, SIDE))
        for _ in range(frames):
            file.write(b"FRAME\n")
            file.seek(SIDE * SIDE * 3 // 2, 1)
        file.truncate()
    robot.sh(f"chown ddxsave:ddx /rec/{LARGE}")
    return robot.keep / "rec" / LARGE


def test_a_recording_is_split_verified_and_deleted(root: pathlib.Path, tmp_path: pathlib.Path) -> None:
    with panel.filming(root, tmp_path / "machine") as robot, Visitor(
            robot, tmp_path / "browser", panel.certificate(robot)) as visitor:
        robot.wait_until("ddxctl recordings | grep -q ' recording$'")
        visitor.open()
        visitor.enters("recordings")
        first = str(recordings(robot)[-1]["recording"])
        visitor.sees(f"document.getElementById('recording-{first}').innerText.includes('recording')")
        assert visitor.browser.value(f"{button(first, 'Delete')} === undefined")  # not while it is being recorded
        visitor.taps("[...document.querySelectorAll('button')].find((one) => one.textContent === 'Split')")
        visitor.sees(button(first, "Verify"))
        visitor.taps(button(first, "Verify"))
        visitor.reads(f"verify {first}: good.")
        visitor.taps(button(first, "Copy"))
        visitor.reads("no USB stick is plugged in")
        visitor.reads(f"copy {first} usb: FAILED.")
        # A job goes on without its visitor and without the panel, alone, until it is stopped by a second tap.
        large(robot, 4000)  # takes seconds, in which the process can be stopped
        visitor.sees(button(LARGE, "Verify"))
        visitor.taps(button(LARGE, "Verify"))
        robot.wait_until(f"kill -STOP {VERIFIES}")
        visitor.taps(button(first, "Verify"))
        visitor.reads("another recording is being copied or verified")
        robot.sh("kill -9 $(pgrep lighttpd)")
        robot.wait_until("[ $(ddxctl logs ddxpanel | grep -c ready) = 2 ]")
        visitor.reads("Log in again: the session is over.")
        visitor.logs_in(PASSPHRASE)
        visitor.reads(f"verify {LARGE}: ")
        visitor.taps("document.getElementById('job-stop')")
        visitor.reads("Stop: it is not finished then")
        assert robot.sh(f"echo {VERIFIES}").strip()
        visitor.agrees("document.getElementById('job-stop')")
        robot.sh(f"kill -CONT {VERIFIES}")
        visitor.reads(f"verify {LARGE}: FAILED.")
        visitor.reads("told to stop")
        robot.wait_until("! pgrep panel-job && ! pgrep ddxrecordings")
        link = f"document.querySelector('#recording-{first} a[download]').href"
        fetched = visitor.browser.value(f"(async () => {{ const answer = await fetch({link});"
                                        "const sum = await crypto.subtle.digest('SHA-256', await answer.arrayBuffer());"
                                        "return [...new Uint8Array(sum)]; })()")
        name = next(one["files"][0] for one in recordings(robot) if one["recording"] == first)
        assert bytes(fetched).hex() == digest((robot.keep / "rec" / name).read_bytes())
        visitor.taps(button(first, "Delete"))
        visitor.sees(button(first, f"Delete {first}: it cannot be fetched any more"))
        assert first in [one["recording"] for one in recordings(robot)]
        visitor.agrees(button(first, "Delete"))
        visitor.sees(f"!document.getElementById('recording-{first}')")
        assert first not in [one["recording"] for one in recordings(robot)]
        visitor.taps("document.getElementById('record-stop')")
        assert recordings(robot)[-1]["state"] == "recording"
        visitor.agrees("document.getElementById('record-stop')")
        robot.wait_until("! ddxctl recordings | grep -q ' recording$'")
        visitor.taps("[...document.querySelectorAll('button')].find((one) => one.textContent === 'Start')")
        robot.wait_until("ddxctl recordings | grep -q ' recording$'")


# The same with a visitor that takes a byte, and the rest after a line.
SLOW = """
import http.client, ssl, sys
link = http.client.HTTPSConnection("127.0.0.1", context=ssl._create_unverified_context(), timeout=60)
link.request("GET", sys.argv[1], headers={"Cookie": sys.argv[2]})
answer = link.getresponse()
answer.read(1)
print(answer.status, flush=True)
sys.stdin.readline()
try:
    while answer.read(1 << 20):
        pass
    print("incomplete" if answer.length else "complete")
except TimeoutError:
    print("waits for the rest")
except (http.client.IncompleteRead, OSError):
    print("incomplete")
"""
LARGE, SIDE = "large.y4m", 2048


class Fetched:
    """A file that a visitor has fetched, or part of it."""

    def __init__(self, robot: NativeMachine, path: str, headers: dict[str, str], most: int | None = None) -> None:
        done = subprocess.run([*MORTAL, *panel.inside(robot), sys.executable, "-c", FETCH], capture_output=True,
                              text=True, check=True, input=json.dumps([path, headers, most]))
        self.status, self.headers, self.size, self.digest = json.loads(done.stdout)


def digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def test_a_recording_is_downloaded(root: pathlib.Path, tmp_path: pathlib.Path) -> None:
    with panel.filming(root, tmp_path / "machine") as robot:
        robot.wait_until("ddxctl recordings | grep -q ' recording$'")
        robot.wait_until("ddxctl stats --json | grep '\"ddxvideosave\"' | grep -q '\"out\":[1-9]'")
        robot.sh("ddxctl record split")
        robot.wait_until("ddxctl recordings | grep -q ' finished$'")
        name = str(recordings(robot)[0]["files"][0])
        file = (robot.keep / "rec" / name).read_bytes()
        cookie = {"Cookie": panel.log_in(robot)}
        path = f"/panel/recording/{name}"
        whole = Fetched(robot, path, cookie)
        assert (whole.status, whole.size, whole.digest) == (200, len(file), digest(file))
        assert whole.headers["Content-Length"] == str(len(file)) and name in whole.headers["Content-Disposition"]
        half = len(file) // 2
        for asked, first, last in ((f"bytes={half}-", half, len(file) - 1), ("bytes=10-5009", 10, 5009)):
            part = Fetched(robot, path, {**cookie, "Range": asked, "If-Range": whole.headers["ETag"]})
            wanted = file[first:last + 1]
            assert (part.status, part.size, part.digest) == (206, len(wanted), digest(wanted)), asked
            assert part.headers["Content-Range"] == f"bytes {first}-{last}/{len(file)}"
        other = Fetched(robot, path, {**cookie, "Range": f"bytes={half}-", "If-Range": '"another"'})
        assert (other.status, other.digest) == (200, digest(file))
        beyond = Fetched(robot, path, {**cookie, "Range": f"bytes={len(file)}-"})
        assert (beyond.status, beyond.headers["Content-Range"]) == (416, f"bytes */{len(file)}")
        running = str(recordings(robot)[-1]["files"][0])
        refused: list[tuple[int, str, dict[str, str]]] = [
            (401, path, {}), (403, path, {**cookie, "Host": "evil.example"}),
            (404, f"/panel/recording/{running}", cookie), (404, "/panel/recording/missing.mp4", cookie),
            (400, "/panel/recording/..%2fpool%2f1", cookie), (400, "/panel/recording/..", cookie),
            (400, "/panel/recording/-size", cookie)]
        assert [Fetched(robot, *one[1:]).status for one in refused] == [one[0] for one in refused]
        assert "ddxrecordings: missing.mp4: there is no such file" in robot.sh("ddxctl logs ddxpanel")
        assert robot.sh("ls -A /tmp") == ""


class Slow(Closing):
    def __init__(self, robot: NativeMachine, path: str, cookie: str) -> None:
        self.process = subprocess.Popen([*MORTAL, *panel.inside(robot), sys.executable, "-c", SLOW, path, cookie],
                                        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def says(self) -> str:
        assert self.process.stdout
        return self.process.stdout.readline().strip()

    def goes_on(self) -> None:
        assert self.process.stdin
        print(file=self.process.stdin, flush=True)

    def end(self) -> None:
        kill(self.process)


def test_a_download_ends_with_its_visitor(root: pathlib.Path, tmp_path: pathlib.Path) -> None:
    """A file far larger than what sockets hold, which is not kept anywhere on its way."""
    with panel.filming(root, tmp_path / "machine") as robot:
        file = large(robot, 10)
        cookie, path = panel.log_in(robot), f"/panel/recording/{LARGE}"
        with Slow(robot, path, cookie) as first, Slow(robot, path, cookie) as second:
            assert [first.says(), second.says()] == ["200", "200"]
            answers = panel.ask(robot, [("GET", path, {"Cookie": cookie}, ""), ("GET", path, {}, ""),
                                        ("POST", "/panel/order", {**OWN, "Cookie": cookie}, "services")])
            assert [answer[0] for answer in answers] == [409, 401, 200]
            assert answers[0][2] == "two files are being fetched already\n"
            assert int(robot.sh("du -sk /tmp").split()[0]) < 2048  # what the web server has not sent yet
            first.end()
            robot.wait_until("[ $(pgrep ddxrecordings | wc -l) = 1 ]")
            robot.sh("kill -9 $(pgrep ddxrecordings)")
            second.goes_on()
            assert second.says() == "incomplete"
        whole = Fetched(robot, path, {"Cookie": cookie})
        assert (whole.status, whole.digest) == (200, digest(file.read_bytes()))
        counters = recorder(robot)
        assert lost(counters) == 0 and counters["out"] > 0
