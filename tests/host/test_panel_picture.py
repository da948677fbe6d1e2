# SPDX-License-Identifier: GPL-2.0-or-later
"""The panel's live picture: in Chromium, judged by the clip's frame numbers, and by requests."""
from __future__ import annotations

import base64
import json
import pathlib
from collections.abc import Iterator
from typing import Any

import numpy
import pytest

from parts.guest import panel
from parts.guest.native_machine import NativeMachine
from parts.guest.panel import FRAMES, OWN, Request, Visitor
from parts.media import clip as numbered_clip

from .programs import lost

pytestmark = pytest.mark.retry

# The number that the page has for the picture that it shows, the sides, and the luma of each pixel.
SAMPLE = """(() => {
    const canvas = document.getElementById("picture");
    const pixels = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
    let luma = "";
    for (let i = 0; i < pixels.length; i += 4)
        luma += String.fromCharCode(0.299 * pixels[i] + 0.587 * pixels[i + 1] + 0.114 * pixels[i + 2]);
    return [Number(canvas.dataset.frame), canvas.width, canvas.height, btoa(luma)];
})()"""
OLD = "document.querySelector('figure.old')"


@pytest.fixture
def robot(root: pathlib.Path, tmp_path: pathlib.Path) -> Iterator[NativeMachine]:
    with panel.filming(root, tmp_path / "machine") as machine:
        yield machine


def shown(visitor: Visitor) -> int:
    """The number of the frame that the page shows, which its picture must have as well."""
    number, width, height, luma = visitor.browser.value(SAMPLE)
    scale = numbered_clip.WIDTH // width  # the page may ask for half the size
    plane = numpy.frombuffer(base64.b64decode(luma), numpy.uint8).reshape(height, width)
    plane = plane.repeat(scale, axis=0).repeat(scale, axis=1)
    assert numbered_clip.frame_number(plane.tobytes(), plane.shape[1], plane.shape[0]) == number % FRAMES
    return int(number)


def recorder(robot: NativeMachine) -> dict[str, Any]:
    books = [json.loads(line) for line in robot.sh("ddxctl stats --json").splitlines()]
    return next(book for book in books if book["instance"] == "ddxvideosave")


def test_the_page_shows_the_newest_frame(robot: NativeMachine, tmp_path: pathlib.Path) -> None:
    robot.wait_until("ddxctl stats --json | grep '\"ddxvideosave\"' | grep -q '\"out\":[1-9]'")
    with Visitor(robot, tmp_path / "browser", panel.certificate(robot)) as visitor:
        visitor.open()
        visitor.enters("picture")
        visitor.sees("document.getElementById('picture').dataset.frame")
        numbers = [shown(visitor)]
        while len(numbers) < 6:
            visitor.sees(f"Number(document.getElementById('picture').dataset.frame) !== {numbers[-1]}")
            numbers.append(shown(visitor))
        assert numbers == sorted(set(numbers))
        visitor.sees(f"!{OLD} && /^frame \\d+ · \\d+ a second · 0 lost · \\d+ ms old/.test("
                     "document.getElementById('state').textContent)")
        process = robot.sh("pgrep ddxvideosnap")  # one, however many requests are open
        assert robot.sh(f"stat -c '%U %G' /proc/{process}") == "ddxpanel ddx"
        # A source that hangs: the last picture stays, in grey.
        loader = robot.sh("pgrep ddxvideoload")
        robot.sh(f"kill -STOP {loader}")
        visitor.sees(f"{OLD} && getComputedStyle(document.getElementById('picture')).filter.includes('grayscale')")
        visitor.reads("old: no new picture for")
        last = shown(visitor)
        robot.sh(f"kill -CONT {loader}")
        visitor.sees(f"!{OLD}")
        assert shown(visitor) > last
        # No process goes on for a page that is not shown.
        visitor.taps("document.querySelector('a[href=\"#services\"]')")
        robot.wait_until("! pgrep ddxvideosnap")
    counters = recorder(robot)
    assert lost(counters) == 0 and counters["out"] > last


def test_requests_for_pictures(robot: NativeMachine) -> None:
    names = ["one", "two:a", "three", "four"]
    for name in names:
        robot.sh(f"ddxvideoload /test/clip.y4m -rate 0 -name {name} -instance {name}")
    inside = {"Cookie": panel.log_in(robot)}

    def get(path: str, **more: str) -> Request:
        return "GET", f"/panel/picture/{path}", {**inside, **more}, ""

    cases: list[tuple[int, Request]] = [
        (401, ("GET", "/panel/picture/one", {}, "")), (403, get("one", Host="evil.example")),
        (405, ("POST", "/panel/picture/one", {**inside, **OWN}, "")),
        (400, get("")), (400, get("..%2fone")), (400, get("one?after=x")), (400, get("one?quality=99")),
        (404, get("missing")), (404, get("ddxvideoload.stats")), (404, get("-help")),
        (200, get("one")), (200, get("one?after=0&quality=16&divisor=2")), (200, get("one?after=49")),
        (204, get("one?after=50")), (200, get("two%3Aa")), (200, get("three")), (409, get("four")), (200, get("one"))]
    answers = panel.ask(robot, [request for _, request in cases])
    assert [(status, case[1]) for (status, _, _), case in zip(answers, cases)] == [
        (wanted, request) for wanted, request in cases]
    pictures = [headers for status, headers, _ in answers if status == 200]
    assert {(one["Content-Type"], one["X-Sequence"], one["X-Frame"], one["X-Lost"]) for one in pictures} == {
        ("image/jpeg", "50", "49", "0")}
    assert int(pictures[0]["Content-Length"]) > int(pictures[1]["Content-Length"])
    assert len(robot.sh("pgrep ddxvideosnap").split()) == 3
    robot.wait_until("! pgrep ddxvideosnap")
    # One that hangs takes no other with it, and is replaced.
    assert panel.ask(robot, [get("one")])[0][0] == 200
    robot.sh("kill -STOP $(pgrep ddxvideosnap)")
    answers = panel.ask(robot, [get("one"), get("one"), get("two%3Aa")])
    assert [status for status, _, _ in answers] == [404, 200, 200] and "hangs" in answers[0][2]
    assert "restarts=0" in robot.sh("ddxctl status ddxpanel")
