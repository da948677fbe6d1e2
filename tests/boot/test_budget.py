# SPDX-License-Identifier: GPL-2.0-or-later
"""The product keeps to budget.txt. The measured values are in output/<board>/budget.json."""
import json
import pathlib
import time
import warnings

import pytest

from lib import budget, sizes
from lib.budget import MIB
from lib.figures import Figure
from parts.common import entries
from parts.guest import machine, session, testdisk
from parts.guest.machine import Machine
from parts.guest.qemu import Boot, Guest
from parts.guest.session import Result
from parts.media.counters import Counters


pytestmark = pytest.mark.retry

# A second of this guest is 500 million instructions, independent of the host and its load. With a second processor, the
# two would count while they wait for each other.
COUNTED = ("-icount", "shift=1", "-smp", "1")
BOOTS = 3


def counted(boot: Boot, clip: pathlib.Path) -> budget.Timeline:
    """The boot with the median time to the first frame."""
    found = []
    for number in range(BOOTS):
        with boot(f"budget{number}", test_disk=clip, accel="tcg,thread=single", extra=COUNTED) as guest:
            guest.shell()
            while not (first_ns := session.follow(guest, 0).get(session.LOAD, Counters()).first_ns):
                time.sleep(0.5)
            found.append(budget.timeline(guest, session.LOAD, first_ns / 1e9))
    return sorted(found, key=lambda one: one.first_frame)[BOOTS // 2]


def save_sizes(image: pathlib.Path, guest: Guest) -> str:
    """Write the sizes of files and the use of memory to output/<board>/sizes.json. Return a table."""
    files, used = sizes.of_image(image.parent / "root"), sizes.of_memory(guest)
    (image.parent / "sizes.json").write_text(json.dumps({"image": files, "memory": used}, indent=1) + "\n")
    return sizes.table(files, used)


@pytest.fixture(scope="session")
def items(request: pytest.FixtureRequest, image: pathlib.Path, guest: Guest, recorded: Result, board: Machine,
          boot: Boot, work: pathlib.Path) -> list[budget.Item]:
    """Measured values with their verdicts. The development image's path is that of a usual boot by the clock, which
    other work disturbs: no figure of it is kept."""
    values = {"root": (image.parent / "rootfs.squashfs").stat().st_size / MIB, "memory": budget.memory(guest)}
    if board.board == machine.DEV:
        tables = [budget.timeline(guest, session.LOAD, recorded.load.first_ns / 1e9).table()]
    else:
        found = counted(boot, work / "clip.img")
        values |= {**found.values(), "image": budget.compressed(image) / MIB}
        tables = [found.table(), save_sizes(image, guest)]
    result = budget.judge(values, board.board)
    with request.config.pluginmanager.getplugin("capturemanager").global_and_fixture_disabled():
        print("\n\n".join([f"\n\n{board.board}, {board.firmware}\n{budget.table(result)}", *tables]))
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


@pytest.mark.long
def test_work_until_the_first_frame(boot: Boot, work: pathlib.Path, short_clip: pathlib.Path,
                                    record_property: Figure) -> None:
    """Of the development image as well, so that a change shows before a board is built."""
    found = counted(boot, testdisk.make(work / "counted.img", short_clip))
    print(found.table())
    for name, value in found.values().items():
        record_property(name, round(value, 3))
        assert value > 0


def test_idle_time_is_no_work() -> None:
    steps = [budget.Step("S02base", 1.5, 0.2, 0.25), budget.Step("S60ddxvideoload", 2.5, 0.5, 0.35)]
    found = budget.Timeline(steps, 3.5, (3.25, 0.5)).values()
    assert found == {"first_frame": 3.5, "start": 0.5, "kernel_work": 1.25, "user_work": 1.75}


def test_verdicts_over_near_and_fine(tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(budget, "BUDGET", tmp_path / "budget.txt")
    budget.BUDGET.write_text("# Limits\nimage 32 MiB a\nroot 30,this=28 MiB b\nmemory 64,other=9 MiB c\n"
                             "user_work 3 s d\nfirst_frame 6 s e\nstart 1 s f\n")
    values = {"image": 32.1, "root": 25.3, "memory": 10.0, "first_frame": 6.0, "start": 0.89}
    verdicts = {one.name: one.verdict for one in budget.judge(values, "this")}
    assert verdicts == {"image": "over", "root": "near", "memory": "fine", "first_frame": "near", "start": "fine"}
    assert [one.limit for one in budget.judge({"root": 25.3, "memory": 10.0}, "other")] == [30, 9]
