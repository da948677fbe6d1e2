# SPDX-License-Identifier: GPL-2.0-or-later
"""The boot counter: GRUB's menu increments it, slot-came-up clears it. The part of grub.cfg that chooses a slot is
close enough to shell syntax to run in a shell."""
from __future__ import annotations

import re
import subprocess
from collections.abc import Iterator

import pytest

from parts.common import TOP, run

from .appliance import Appliance

pytestmark = pytest.mark.retry

Block = dict[str, str]
NAMES = ("slot", "left", "begun", "failed")
MOUNT = "mount -t vfat -o rw,noatime,nosuid,nodev,noexec"
LOST = ", so a slot that cannot be booted may stay the chosen one; flash another card\n"


def menu(block: Block) -> tuple[Block, str, str]:
    """The block after GRUB's menu, the slot that it boots, and the count that it reports."""
    text = (TOP / "board/common/grub.cfg").read_text()
    choice = text[text.index("set slot=A\n"):text.index('if [ "$slot" = B ]; then set partition=')]
    known = "; ".join(f"{name}={value}" for name, value in block.items())
    script = (f"load_env() {{ :; {known}; }}\n" if known else "load_env() { :; }\n") + (
        'save_env() { for name; do eval "echo $name=\\${$name-}"; done; }\n'
        + re.sub(r"\bset (\w+)=", r"\1=", choice) + 'echo "boot $slot $counted"\n')
    done = subprocess.run(["sh", "-c", script], check=True, capture_output=True, text=True)
    assert not done.stderr
    *saved, last = done.stdout.splitlines()
    now = {**block, **dict(line.split("=") for line in saved)}
    _, slot, *counted = last.split()
    return {name: value for name, value in now.items() if value}, slot, "".join(counted)


class Robot:
    """An appliance with a boot partition."""

    def __init__(self, appliance: Appliance) -> None:
        self.appliance = appliance
        self.file = appliance.root / "card/grub/grubenv"
        self.file.parent.mkdir(parents=True)
        text = (TOP / "overlay/usr/libexec/ddx/slot-came-up").read_text()
        assert MOUNT in text
        appliance.add("usr/libexec/ddx/slot-came-up", text.replace(MOUNT, "mount -o bind"))
        appliance.add("usr/libexec/ddx/own-partition", "#!/bin/sh\necho /card\n")
        self.words = appliance.root / "run/words"
        self.words.touch()
        assert appliance.run("mount -o bind /run/words /proc/cmdline") == (0, "")

    def comes_up(self, block: Block, words: str) -> Block:
        lines = "".join(f"{name}={value}\n" for name, value in block.items())
        self.file.write_text(f"# GRUB Environment Block\n{lines}".ljust(1024, "#"))
        self.words.write_text(f"root=x {words} quiet\n")
        for name in ("failed", "wrong"):
            (self.appliance.root / f"run/slot.{name}").unlink(missing_ok=True)
        self.appliance.run("/usr/libexec/ddx/slot-came-up")
        text = self.file.read_text()
        assert len(text) == 1024 and not (self.appliance.root / "run/grubenv").exists()
        return dict(line.split("=") for line in text.splitlines() if not line.startswith("#"))

    def said(self, name: str) -> str:
        path = self.appliance.root / f"run/slot.{name}"
        return path.read_text() if path.exists() else ""

    def boot(self, block: Block, good: str) -> tuple[Block, str]:
        """Boot once; only the slot `good` comes up."""
        counted, slot, words = menu(block)
        assert (counted.get("left"), counted.get("begun")) != (block.get("left"), block.get("begun")), "not counted"
        return (self.comes_up(counted, f"ddx.slot={slot} ddx.counted={words}") if slot == good else counted), slot


@pytest.fixture(name="robot", scope="module")
def _robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    appliance = Appliance(tmp_path_factory.mktemp("slots"))
    yield Robot(appliance)
    appliance.end()


@pytest.mark.parametrize("block, words, after, failed", [
    ({"begun": "1"}, "ddx.slot=A ddx.counted=begun=1", {}, ""),
    ({"slot": "B", "left": "2"}, "ddx.slot=B ddx.counted=left=2", {"slot": "B"}, ""),
    ({"begun": "2"}, "ddx.slot=B ddx.counted=begun=2", {"begun": "2"}, "A"),
    ({"slot": "B", "left": "1"}, "ddx.slot=A ddx.counted=left=1", {"slot": "B", "left": "1"}, "B"),  # unreadable B
    ({"begun": "1", "failed": "B"}, "ddx.slot=A ddx.counted=begun=1", {"failed": "B"}, "B"),
    ({"begun": "2", "failed": "B"}, "ddx.slot=B ddx.counted=begun=2", {"begun": "2"}, "A"),
    ({"slot": "B", "left": "0"}, "ddx.slot=A", {"failed": "B"}, "B"),  # a loader that does not clear it itself
    ({"begun": "1"}, "ddx.slot=A ddx.counted=begun=1 ddx.rescue", {"begun": "1"}, ""),
])
def test_a_running_slot_clears_the_count(robot: Robot, block: Block, words: str, after: Block, failed: str) -> None:
    assert robot.comes_up(block, words) == after
    assert (robot.said("failed").strip(), robot.said("wrong")) == (failed, "")


@pytest.mark.parametrize("file", ["board/common/grub.cfg", "overlay/boot/cmdline.cfg"])
def test_grub_can_parse(file: str) -> None:
    run(["grub-script-check", TOP / file])


@pytest.mark.parametrize("block, counted", [({}, "begun=1"), ({"slot": "B", "left": "3"}, "left=2")])
def test_a_loader_that_does_not_count_is_reported(robot: Robot, block: Block, counted: str) -> None:
    robot.comes_up(block, f"ddx.slot={block.get('slot', 'A')} ddx.counted={counted}")
    assert robot.said("wrong") == f"the boot loader has not counted this boot{LOST}"


def test_an_unusable_boot_partition_is_reported(robot: Robot) -> None:
    partition = robot.appliance.root / "usr/libexec/ddx/own-partition"
    text = partition.read_text()
    partition.write_text("#!/bin/sh\necho /none\n")
    robot.comes_up({"begun": "1"}, "ddx.slot=A ddx.counted=begun=1")
    partition.write_text(text)
    assert robot.said("wrong") == f"the boot partition cannot be mounted{LOST}"


@pytest.mark.parametrize("first", [{}, {"begun": "3"}, {"slot": "B", "left": "3"}, {"slot": "B", "left": "0"}],
                         ids=["fresh", "gave-way", "updated", "no-boots-left"])
def test_a_working_slot_is_found_within_four_boots(robot: Robot, first: Block) -> None:
    """First only one slot comes up, then only the other, then the first again."""
    block = first
    for good in ("A", "B", "A"):
        slots = []
        while good not in slots:
            block, slot = robot.boot(block, good)
            slots.append(slot)
            assert len(slots) <= 4, slots
        for _ in range(2):  # the chosen slot may get one more attempt in between
            block, slot = robot.boot(block, good)
            slots.append(slot)
        assert good in slots[-2:]
