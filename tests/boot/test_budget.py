# SPDX-License-Identifier: GPL-2.0-or-later
"""The product keeps to board/common/budget.txt. The measured values are in output/<board>/budget.json."""
import json
import pathlib
import time
import warnings

import pytest

from lib import budget
from lib.budget import MIB
from parts.common import entries
from parts.guest import machine, session
from parts.guest.machine import Machine
from parts.guest.qemu import Boot, Guest
from parts.guest.session import Result
from parts.media.counters import Counters

pytestmark = pytest.mark.retry

# A second of this guest is 500 million instructions, independent of the host and its load.
COUNTED = ("-icount", "shift=1")


@pytest.fixture(scope="session")
def items(request: pytest.FixtureRequest, image: pathlib.Path, guest: Guest, recorded: Result, board: Machine,
          boot: Boot, work: pathlib.Path) -> list[budget.Item]:
    """Measured values with their verdicts. The development image's times come from a usual boot."""
    first_ns, found = recorded.load.first_ns, budget.starts(guest)
    if board.board != machine.DEV:
        with boot("budget", test_disk=work / "clip.img", accel="tcg", extra=COUNTED) as counted:
            counted.shell()
            while not (first_ns := session.follow(counted, 0).get(session.LOAD, Counters()).first_ns):
                time.sleep(0.5)
            found = budget.starts(counted)
    first_frame = first_ns / 1e9
    values = {"root": (image.parent / "rootfs.squashfs").stat().st_size / MIB, "memory": budget.memory(guest),
              "first_frame": first_frame, "start": max(took for _, _, took in found)}
    if board.board != machine.DEV:
        values["image"] = budget.compressed(image) / MIB
    result = budget.judge(values)
    with request.config.pluginmanager.getplugin("capturemanager").global_and_fixture_disabled():
        print(f"\n\n{board.board}, {board.firmware}\n{budget.table(result)}\n\n{budget.path(found, first_frame)}")
    (image.parent / "budget.json").write_text(json.dumps(
        {one.name: {"value": one.value, "limit": one.limit, "unit": one.unit, "verdict": one.verdict}
         for one in result}, indent=2) + "\n")
    return result


def test_the_product_keeps_to_its_budget(items: list[budget.Item], board: Machine) -> None:
    if board.board == machine.DEV:
        pytest.skip("the budget is the product's; the development image's figures are in output/dev/budget.json")
    for one in items:
        if one.verdict == "near":
            warnings.warn(f"{one.name}: {one.value} of {one.limit} {one.unit}")
    assert len(items) == len(entries(budget.BUDGET))
    assert not [one for one in items if one.verdict == "over"], budget.table(items)


def test_verdicts_over_near_and_fine() -> None:
    values = {"image": 32.1, "root": 25.3, "memory": 10.0, "first_frame": 6.0, "start": 0.89}
    verdicts = {one.name: one.verdict for one in budget.judge(values)}
    assert verdicts == {"image": "over", "root": "near", "memory": "fine", "first_frame": "near", "start": "fine"}
