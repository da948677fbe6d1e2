# SPDX-License-Identifier: GPL-2.0-or-later
"""Many visitors of the panel at once, on a machine that records: no frame is lost, nothing grows, and the panel answers
again."""
from __future__ import annotations

import contextlib
import json
import pathlib
import subprocess
import sys
import time
from collections.abc import Iterator

import pytest

import endurance
from lib.figures import Figure
from parts.common import MORTAL, wait_until
from parts.guest import panel
from parts.guest.native_disk import NativeDisk
from parts.guest.native_machine import NativeMachine
from parts.guest.panel import OWN, Visitor
from parts.media.footage import footage
from parts.processes import Client, kill

from . import absent
from .programs import lost
from .test_panel_name import FIRST, Neighbour
from .test_panel_picture import recorder
from .test_panel_recordings import digest, recordings

pytestmark = [pytest.mark.retry, pytest.mark.long]

VIEWERS, DOWNLOADS, PICTURES = 4, 2, 500
DISK, SEGMENT, BEGUN = 192, 16, 4  # MB of /rec and of a file; files that the recorder begins meanwhile
# Watches an item as the page does, until it had that many pictures; prints their numbers.
WATCHES = """
import http.client, json, ssl, sys
link = http.client.HTTPSConnection("127.0.0.1", context=ssl._create_unverified_context(), timeout=300)
numbers, after = [], "0"
while len(numbers) < int(sys.argv[2]):
    link.request("GET", f"/panel/picture/video?after={after}&quality=6", headers={"Cookie": sys.argv[1]})
    answer = link.getresponse()
    body = answer.read()
    if answer.status == 200:
        assert body.startswith(b"\\xff\\xd8"), body[:20]
        after = answer.headers["X-Sequence"]
        numbers.append(int(after))
    else:
        assert answer.status == 204, answer.status
print(json.dumps(numbers))
"""
# Downloads a file, in as many seconds as it has pieces; prints size and SHA-256.
FETCHES = """
import hashlib, http.client, json, ssl, sys, time
link = http.client.HTTPSConnection("127.0.0.1", context=ssl._create_unverified_context(), timeout=300)
link.request("GET", sys.argv[2], headers={"Cookie": sys.argv[1]})
answer = link.getresponse()
assert answer.status == 200, answer.status
digest, size = hashlib.sha256(), 0
while piece := answer.read(1 << 19):
    digest.update(piece)
    size += len(piece)
    time.sleep(1)
print(json.dumps([size, digest.hexdigest()]))
"""
HALF_OPEN = 200
# Opens that many connections, every second one with the beginning of a greeting, and holds them.
HOLDS = """
import socket, sys
held = []
for number in range(int(sys.argv[1])):
    one = socket.socket()
    one.setblocking(False)
    one.connect_ex(("127.0.0.1", 443))
    held.append(one)
for one in held[::2]:
    try:
        one.send(bytes.fromhex("160301020001000001fc0303"))
    except OSError:
        pass
print(len(held), flush=True)
sys.stdin.readline()
"""
REQUESTS, WARM_UP, LOOK = 10_000, 1_000, 1_000
# Sends requests on one connection; each line of standard input is a number of rounds of the requests in argv[1].
ASKS = """
import http.client, json, ssl, sys
requests, context = json.loads(sys.argv[1]), ssl._create_unverified_context()
for line in sys.stdin:
    link, found = http.client.HTTPSConnection("127.0.0.1", context=context, timeout=300), {}
    for number in range(int(line)):
        method, path, headers, body = requests[number % len(requests)]
        link.request(method, path, body, headers)
        answer = link.getresponse()
        answer.read()
        found[answer.status] = found.get(answer.status, 0) + 1
    link.close()
    print(json.dumps(found), flush=True)
"""
LINK = 200  # kbit/s
RATE, SECONDS = 3, 30
COUNT = """
globalThis.drawn = 0;
new MutationObserver(() => { globalThis.drawn++; }).observe(document.getElementById("picture"),
    { attributeFilter: ["data-frame"] });
"""


def program(robot: NativeMachine, text: str, *words: str) -> subprocess.Popen[str]:
    return subprocess.Popen([*MORTAL, *panel.inside(robot), sys.executable, "-c", text, *words], text=True,
                            stdin=subprocess.PIPE, stdout=subprocess.PIPE)


def test_viewers_and_downloads_while_the_recorder_recycles(root: pathlib.Path, tmp_path: pathlib.Path) -> None:
    keep = tmp_path / "machine"
    (keep / "rec").mkdir(parents=True)
    settings = {"ddxvideosave": f"segment={SEGMENT}\nfull=recycle\n"}
    with NativeDisk(DISK, keep / "rec"), panel.filming(root, keep, settings=settings) as robot:
        def first() -> str:
            return str(recordings(robot)[0]["files"][0]) if recordings(robot) else ""

        begin = ""

        def recycles() -> bool:
            nonlocal begin
            begin = begin or first()
            return bool(begin) and first() != begin

        wait_until(recycles, "no file is recycled", 1)
        cookie = panel.log_in(robot)
        files = [name for one in recordings(robot) for name in one["files"]]
        chosen = files[-1 - DOWNLOADS:-1]  # the last one is being recorded
        wanted = [(keep / "rec" / name).read_bytes() for name in chosen]
        viewers = [program(robot, WATCHES, cookie, str(PICTURES)) for _ in range(VIEWERS)]
        downloads = [program(robot, FETCHES, cookie, f"/panel/recording/{name}") for name in chosen]
        for one in viewers:
            numbers = json.loads(one.communicate()[0])
            assert len(numbers) == PICTURES and numbers == sorted(set(numbers))
        for one, data in zip(downloads, wanted):
            assert json.loads(one.communicate()[0]) == [len(data), digest(data)]
        left = {name for one in recordings(robot) for name in one["files"]}
        assert len(set(files) - left) >= BEGUN  # recycled meanwhile
        counters = recorder(robot)
        assert lost(counters) == 0 and counters["out"] > PICTURES
        assert "restarts=0" in robot.sh("ddxctl status ddxpanel")


def test_half_open_connections(root: pathlib.Path, tmp_path: pathlib.Path, record_property: Figure) -> None:
    programs = (*endurance.STAYING, "ddxpanel", "lighttpd", "ddxvideosave")
    with panel.filming(root, tmp_path / "machine") as robot:
        order = ("POST", "/panel/order", {**OWN, "Cookie": panel.log_in(robot)}, "services")
        looks, waits = [endurance.look(robot, programs)], []
        for _ in range(3):  # the first time, the web server gets the memory for all its connections
            holder = program(robot, HOLDS, str(HALF_OPEN))
            assert holder.stdout and holder.stdout.readline().strip() == str(HALF_OPEN)
            begin = time.monotonic()
            assert panel.ask(robot, [order], 300)[0][0] == 200  # a visitor waits for a place
            waits.append(round(time.monotonic() - begin, 1))
            kill(holder)
            robot.wait_until("[ $(netstat -tn | grep -c ':443 .*ESTABLISHED') = 0 ]")
            looks.append(endurance.look(robot, programs))
        record_property("a_visitor_waits_s", waits)
        record_property("lighttpd_KiB", [one["lighttpd"] for one in looks])
        assert endurance.growth(looks[1:]) == []
        counters = recorder(robot)
        assert lost(counters) == 0 and counters["out"] > 0
        assert "restarts=0" in robot.sh("ddxctl status ddxpanel")


def test_nothing_grows_with_requests(root: pathlib.Path, tmp_path: pathlib.Path, record_property: Figure) -> None:
    programs = (*endurance.STAYING, "ddxpanel", "lighttpd")
    with panel.filming(root, tmp_path / "machine") as robot:
        inside = {**OWN, "Cookie": panel.log_in(robot)}
        requests = [*(("GET", f"/{name}", {}, None) for name in ("", "style.css", "panel.js", "views.js", "missing")),
                    *(("GET", path, inside, None) for path in ("/panel/session", "/panel/picture/video?after=0",
                                                               "/panel/recording/missing.mp4")),
                    ("GET", "/panel/session", {}, None), ("POST", "/panel/order", {**inside, "X-Panel": "2"}, "job"),
                    ("POST", "/panel/order", inside, "reboot"), ("POST", "/panel/order", {**inside, "Origin": "x"}, ""),
                    *[("GET", "/panel/session", inside, None)] * 8]
        client = Client([*MORTAL, *panel.inside(robot), sys.executable, "-c", ASKS, json.dumps(requests)])
        client.ask(WARM_UP)
        looks, found = [endurance.look(robot, programs)], {"200": 0}
        for _ in range(REQUESTS // LOOK):
            for status, count in client.ask(LOOK).items():
                found[status] = found.get(status, 0) + count
            looks.append(endurance.look(robot, programs))
        client.end()
        record_property("first", looks[0])
        record_property("last", looks[-1])
        part = REQUESTS // len(requests)
        assert found == {"200": 15 * part, "404": 2 * part, "401": part, "400": part, "403": part}
        assert endurance.growth(looks) == []
        counters = recorder(robot)
        assert lost(counters) == 0 and "restarts=0" in robot.sh("ddxctl status ddxpanel")


@contextlib.contextmanager
def slow_link(robot: NativeMachine) -> Iterator[Neighbour]:
    """A machine at the other end of a cable that carries LINK kbit/s each way."""
    neighbour = Neighbour(robot)
    try:
        robot.sh(f"ip link set eth0 up; ip addr add {FIRST}/24 dev eth0")
        for words in (panel.inside(robot), neighbour.inside):
            done = subprocess.run([*MORTAL, *words, "tc", "qdisc", "add", "dev", "eth0", "root", "tbf", "rate",
                                   f"{LINK}kbit", "burst", "4kb", "latency", "400ms"], capture_output=True, text=True)
            if done.returncode:
                absent.not_installed(f"this kernel does not limit the rate of a network: {done.stderr.strip()}")
        # Chromium gives up what it loads when the network changes: wait until all addresses are there.
        robot.wait_until("! ip addr show dev eth0 | grep -q tentative")
        wait_until(lambda: "tentative" not in neighbour.run("ip", "addr", "show", "dev", "eth0"), "no address")
        yield neighbour
    finally:
        kill(neighbour.process)


def test_pictures_over_a_slow_link(root: pathlib.Path, tmp_path: pathlib.Path, record_property: Figure) -> None:
    street = footage(tmp_path / "street.y4m", 250, "352:288")
    with panel.filming(root, tmp_path / "machine", street) as robot, slow_link(robot) as neighbour, Visitor(
            robot, tmp_path / "browser", panel.certificate(robot), words=neighbour.inside) as visitor:
        visitor.open(f"https://{FIRST}/")
        visitor.enters("picture")
        visitor.sees("document.getElementById('picture').dataset.frame")
        visitor.sees("document.getElementById('picture').width === 176")  # the page has found out how slow it is
        inside = {"Cookie": panel.log_in(robot)}
        answers = panel.ask(robot, [("GET", f"/panel/picture/video?after=0&quality={quality}", inside, "")
                                    for quality in (16, 10, 6, 3)])
        record_property("KB_with_q_16_10_6_3", [round(int(one[1]["Content-Length"]) / 1000, 1) for one in answers])
        visitor.browser.value(COUNT)
        before = time.monotonic()
        time.sleep(SECONDS)
        rate = visitor.browser.value("drawn") / (time.monotonic() - before)
        record_property("pictures_a_second", round(rate, 1))
        record_property("line", visitor.browser.value("document.getElementById('state').textContent"))
        assert rate >= RATE
        counters = recorder(robot)
        assert lost(counters) == 0 and counters["out"] > 0
