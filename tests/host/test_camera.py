# SPDX-License-Identifier: GPL-2.0-or-later
"""The grabbers without a camera: wrong usage, and waiting. Tests with cameras: tests/boot/test_camera*.py."""
from __future__ import annotations

import json
import pathlib
import time

import pytest

from .programs import Desk, stop, wait_until

pytestmark = pytest.mark.retry

GRABBER, IIDC = "ddxvideoV4L", "ddxvideo1394"


@pytest.mark.parametrize("arguments, text", [
    (["-camera", "front"], "-camera front: a number or a path such as /dev/video0 is needed"),
    (["-camera", "/" + "x" * 64], "a number or a path"),
    (["-skip", "0"], "-skip 0: a number from 1"),
    (["--size", "CIFF"], "-size CIFF: one of QCIF, CIF"),
    (["-size", "351x288"], "-size 351x288: one of"),
    (["-standard", "PALE"], "-standard PALE: PAL, NTSC or SECAM"),
    (["-deinterlace", "weave"], "-deinterlace weave: only `stack`"),
    (["-format", "RGB3"], "-format RGB3: unknown"),
    (["-layout", "YUV411P"], "-layout YUV411P: YUV420P, YUV422P, YUV444P, GREY8, GREY16 or RGB24 is needed"),
    (["-rate", "0"], "-rate 0: a number from 1"),
    (["-input"], "-input needs a value"),
    (["0"], "unexpected argument 0"),
])
def test_wrong_usage_is_one_line(desk: Desk, arguments: list[str], text: str) -> None:
    result = desk.run(GRABBER, *arguments)
    assert result.returncode == 2 and not result.stdout
    assert text in result.stderr and result.stderr.count("\n") == 1


@pytest.mark.strict
@pytest.mark.parametrize("camera, state", [("/dev/video99", "not there"), ("/dev/null", "no video device")])
def test_the_v4l_grabber_waits_and_reports_why_once(desk: Desk, camera: str, state: str) -> None:
    grabber = desk.start(GRABBER, "--camera", camera, "-size", "CIF")
    wait_until(lambda: state in desk.errors(grabber))
    time.sleep(1)
    assert desk.errors(grabber) == f"{GRABBER}: {camera}: {state}\n"
    found = json.loads(desk.run("ddxctl", "list", "--json").stdout)
    assert [item["name"] for item in found["items"]] == [f"{GRABBER}.stats"]  # another program may write the video item
    status, counters = stop(grabber)
    assert status == 0
    assert (counters["in"], counters["out"], counters["skipped"], sum(counters["lost"].values())) == (0, 0, 0, 0)


def test_a_grabber_may_start_before_the_store(tmp_path: pathlib.Path) -> None:
    desk = Desk(tmp_path)
    stop(desk.store)
    grabber = desk.start(GRABBER, "-camera", "99")
    wait_until(lambda: "waiting for it" in desk.errors(grabber))
    assert stop(grabber)[0] == 0
    desk.end()


@pytest.mark.parametrize("arguments, text", [
    (["-camera", "front"], "-camera front: a number or a GUID of 16 digits"),
    (["-camera", "00b09d0100abcdeg"], "a number or a GUID"),
    (["-layout", "YUV411P"], "-layout YUV411P: YUV420P, YUV422P, YUV444P, GREY8, GREY16 or RGB24 is needed"),
    (["-camera", "0000000000000000"], "a number or a GUID"),
    (["-mode", "640x480"], "-mode 640x480: unknown"),
    (["-mode", "640x480_MONO8", "-format", "MONO8"], "-format: only the modes FORMAT7_0 to FORMAT7_7"),
    (["-mode", "640x480_MONO8", "-roi", "0,0,64,64"], "-roi: only the modes FORMAT7_0 to FORMAT7_7"),
    (["-format", "YUV420"], "-format YUV420: one of MONO8"),
    (["-roi", "0,0,64"], "-roi 0,0,64: four numbers"),
    (["-roi", "0,0,63,64"], "an even width and height"),
    (["-roi", "0,0,64,64,"], "four numbers"),
    (["-roi", "0,0,99999999999999999999,64"], "four numbers"),
    (["-rate", "0"], "-rate 0: a number above 0"),
    (["-rate", "nan"], "-rate nan: a number above 0"),
    (["-bayer", "RGBG"], "-bayer RGBG: one of RGGB"),
    (["-size", "351x288"], "-size 351x288: one of"),
])
def test_wrong_usage_of_the_iidc_grabber_is_one_line(desk: Desk, arguments: list[str], text: str) -> None:
    result = desk.run(IIDC, *arguments)
    assert result.returncode == 2 and not result.stdout
    assert text in result.stderr and result.stderr.count("\n") == 1


@pytest.mark.parametrize("arguments", [["-format", "mono8"], ["-mode", "format7_2", "-roi", "0,8,64,64"],
                                       ["-camera", "0x00B09D0100ABCDEF", "-mode", "160x120_YUV444", "-rate", "7.5"]])
def test_good_usage_of_the_iidc_grabber(desk: Desk, arguments: list[str]) -> None:
    assert desk.run(IIDC, "-check", *arguments).returncode == 0


def test_the_iidc_grabber_waits_and_reports_it_once(desk: Desk) -> None:
    grabber = desk.start(IIDC, "-camera", "00b09d0100abcdef", "-name", "right")
    wait_until(lambda: "not there" in desk.errors(grabber))
    time.sleep(1)
    own = [line for line in desk.errors(grabber).splitlines() if not line.startswith(f"{IIDC}: libdc1394: ")]
    assert own == [f"{IIDC}: camera 00b09d0100abcdef: not there"]
    assert stop(grabber)[0] == 0


def test_the_list_reports_that_there_is_no_camera(desk: Desk) -> None:
    result = desk.run(IIDC, "-list")
    assert result.returncode == 1 and not result.stdout
    assert result.stderr.splitlines()[-1].startswith(f"{IIDC}: found no IIDC camera")
