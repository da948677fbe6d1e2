# SPDX-License-Identifier: GPL-2.0-or-later
"""ddxvideoV4L where there is no camera: what is typed wrong, and waiting. Cameras are in tests/boot/test_camera*.py."""
from __future__ import annotations

import json
import pathlib
import time

import pytest

from .programs import Desk, stop, wait_until

GRABBER = "ddxvideoV4L"


@pytest.mark.parametrize("arguments, text", [
    (["-camera", "front"], "-camera front: a number or a path such as /dev/video0 is needed"),
    (["-camera", "/" + "x" * 64], "a number or a path"),
    (["-skip", "0"], "-skip 0: a number from 1"),
    (["--size", "CIFF"], "-size CIFF: one of QCIF, CIF"),
    (["-size", "351x288"], "-size 351x288: one of"),
    (["-standard", "PALE"], "-standard PALE: PAL, NTSC or SECAM"),
    (["-deinterlace", "weave"], "-deinterlace weave: only `stack`"),
    (["-format", "RGB3"], "-format RGB3: unknown"),
    (["-rate", "0"], "-rate 0: a number from 1"),
    (["-input"], "-input needs a value"),
    (["0"], "unexpected argument 0"),
])
def test_wrong_usage_is_one_line(desk: Desk, arguments: list[str], text: str) -> None:
    result = desk.run(GRABBER, *arguments)
    assert result.returncode == 2 and not result.stdout
    assert text in result.stderr and result.stderr.count("\n") == 1


@pytest.mark.parametrize("camera, state", [("/dev/video99", "not there"), ("/dev/null", "no video device")])
def test_it_waits_and_says_why_once(desk: Desk, camera: str, state: str) -> None:
    grabber = desk.start(GRABBER, "--camera", camera, "-size", "CIF")
    wait_until(lambda: state in desk.errors(grabber))
    time.sleep(1)
    assert desk.errors(grabber) == f"{GRABBER}: {camera}: {state}\n"
    found = json.loads(desk.run("ddxctl", "list", "--json").stdout)
    assert [item["name"] for item in found["items"]] == [f"{GRABBER}.stats"]  # nothing in the way of another source
    status, counters = stop(grabber)
    assert status == 0
    assert (counters["in"], counters["out"], counters["skipped"], sum(counters["lost"].values())) == (0, 0, 0, 0)


def test_it_is_there_before_the_store(tmp_path: pathlib.Path) -> None:
    desk = Desk(tmp_path)
    stop(desk.store)
    grabber = desk.start(GRABBER, "-camera", "99")
    wait_until(lambda: "waiting for it" in desk.errors(grabber))
    assert stop(grabber)[0] == 0
    desk.end()
