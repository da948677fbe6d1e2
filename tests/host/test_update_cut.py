# SPDX-License-Identifier: GPL-2.0-or-later
"""A power cut at any write of an update leaves a disk that boots a whole version, and nothing else is written."""
from __future__ import annotations

import functools
import pathlib

import pytest

from lib import update_cut
from lib.boot_block import BYTES, Block, menu
from lib.figures import Figure
from lib.update_cut import DATA, SLOTS
from parts.disk.logged_device import lacking

from .update_disk import FORMER, NEW, RUNNING, UpdateDisk

pytestmark = [pytest.mark.computes, pytest.mark.retry]

STEPS = pytest.mark.parametrize("step", [32, pytest.param(1, marks=pytest.mark.long)], ids=["some", "all"])


@functools.cache
def _chosen(items: tuple[tuple[str, str], ...]) -> str:
    return menu(dict(items))[1]


def chosen(block: Block) -> str:
    return _chosen(tuple(sorted(block.items())))


def run_update(disk: UpdateDisk, commands: str) -> None:
    """The commands in turn; `keep` and `return` are those of the other slot's trial."""
    for command in commands.split():
        if command in ("keep", "return"):
            disk.words(f"ddx.slot={disk.other} ddx.layout=1 ddx.counted=left=3")
            done = disk.run(command)
        else:
            done = disk.run(command, stdin=disk.update() if command == "write" else b"")
        assert done.returncode == 0, f"{command}: {done.stderr}"


def judge(disk: UpdateDisk, step: int, firm: bool) -> int:
    """Return the number of states that were judged."""
    disk.stop()
    cuts = update_cut.Cuts(disk.before, disk.block_at, disk.device.log, step)
    assert cuts.strays([(disk.block_at, BYTES), SLOTS[disk.other], DATA]) == []
    whole, count = [disk.roots[RUNNING], disk.roots[NEW], disk.roots[FORMER]], 0
    found: list[str] = []
    for state in cuts.states():
        count += 1
        found += update_cut.wrong(state, chosen, whole, firm)
    assert not found, f"{len(found)} of {count} states: {found[:5]}"
    assert count >= 300
    return count


@pytest.mark.parametrize("here", ["A", "B"])
@STEPS
def test_no_power_cut_leaves_half_a_version(tmp_path: pathlib.Path, here: str, step: int,
                                            record_property: Figure) -> None:
    """GRUB counts boots in `start` as `keep` sees it: the block after its first boot is part of test_slots.py."""
    if reason := lacking():
        pytest.skip(reason)
    with UpdateDisk(tmp_path, here) as disk:
        run_update(disk, "write start keep")
        assert disk.slot(disk.other).startswith(disk.roots[NEW])
        assert disk.slot(here).startswith(disk.roots[RUNNING])
        assert disk.block() == ({"slot": "B"} if disk.other == "B" else {})
        record_property("states", judge(disk, step, firm=True))


@STEPS
def test_no_power_cut_while_a_version_is_taken_back(tmp_path: pathlib.Path, step: int,
                                                    record_property: Figure) -> None:
    if reason := lacking():
        pytest.skip(reason)
    with UpdateDisk(tmp_path, "A") as disk:
        run_update(disk, "write start return")
        assert disk.block() == {"failed": "B"}
        record_property("states", judge(disk, step, firm=True))


@STEPS
def test_a_slot_that_did_not_come_up_is_filled_again(tmp_path: pathlib.Path, step: int,
                                                     record_property: Figure) -> None:
    """The other slot is the chosen one when the update begins, and not whole."""
    if reason := lacking():
        pytest.skip(reason)
    with UpdateDisk(tmp_path, "A", former=False, block={"slot": "B", "begun": "2"}) as disk:
        run_update(disk, "write start keep")
        assert disk.block() == {"slot": "B"}
        record_property("states", judge(disk, step, firm=False))
