# SPDX-License-Identifier: GPL-2.0-or-later
"""The boot counter: GRUB's menu increments it, slot-came-up clears it. The FAT is one of mkfs.vfat's, in a file."""
from __future__ import annotations

import pathlib
from collections.abc import Iterator

import pytest

from lib.boot_block import BYTES, Block, block_of, make_fat, menu, text_of
from parts.common import TOP, run
from parts.image import native

from .appliance import Appliance
from .programs import library_folder

pytestmark = pytest.mark.retry

LOST = ", so a slot that cannot be booted may stay the chosen one; flash another card\n"


class Robot:
    """An appliance with a boot partition."""

    def __init__(self, appliance: Appliance) -> None:
        self.appliance = appliance
        self.card, self.state = appliance.root / "card", appliance.root / "data/update"
        self.state.parent.mkdir()
        make_fat(self.card, {})
        image = self.card.read_bytes()
        self.at = image.index(text_of({}))
        assert image.count(text_of({})) == 1
        self.rest = image[:self.at] + image[self.at + BYTES:]
        appliance.install("overlay/usr/libexec/ddx/slot-came-up", "usr/libexec/ddx/slot-came-up")
        appliance.add("usr/libexec/ddx/own-partition", "#!/bin/sh\necho /card\n")
        appliance.install_program(native.build() / "usr/libexec/ddx/ddxupdate", "usr/libexec/ddx/ddxupdate")
        self.words = appliance.root / "run/words"
        self.words.touch()
        assert appliance.run("mount -o bind /run/words /proc/cmdline") == (0, "")

    def comes_up(self, block: Block, words: str) -> Block:
        return self.comes_up_with(text_of(block), words)

    def comes_up_with(self, block: bytes, words: str) -> Block:
        with self.card.open("r+b") as file:
            file.seek(self.at)
            file.write(block)
        self.words.write_text(f"root=x {words} ddx.layout=1 quiet\n")
        for name in ("failed", "wrong"):
            (self.appliance.root / f"run/slot.{name}").unlink(missing_ok=True)
        self.appliance.run("/usr/libexec/ddx/slot-came-up; /usr/libexec/ddx/ddxupdate keep /card")  # if it is on trial
        image = self.card.read_bytes()
        assert image[:self.at] + image[self.at + BYTES:] == self.rest, "something else of the FAT was written"
        text = image[self.at:self.at + BYTES]
        found = block_of(text)
        assert found is not None and text == text_of(found)
        return found

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
    ({"slot": "B", "left": "1"}, "ddx.slot=A ddx.counted=left=1", {"failed": "B"}, "B"),  # unreadable B
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


@pytest.mark.parametrize("device, said", [
    ("/none", "the boot loader's block cannot be found"),
    ("/run/words", "the boot loader's block cannot be found")])
def test_an_unusable_boot_partition_is_reported(robot: Robot, device: str, said: str) -> None:
    partition = robot.appliance.root / "usr/libexec/ddx/own-partition"
    text = partition.read_text()
    partition.write_text(f"#!/bin/sh\necho {device}\n")
    assert robot.comes_up({"begun": "1"}, "ddx.slot=A ddx.counted=begun=1") == {"begun": "1"}
    partition.write_text(text)
    assert robot.said("wrong") == f"{said}{LOST}"


def test_a_program_that_fails_is_reported(robot: Robot) -> None:
    program = robot.appliance.root / "usr/libexec/ddx/ddxupdate"
    program.chmod(0o644)
    robot.comes_up({"begun": "1"}, "ddx.slot=A ddx.counted=begun=1")
    program.chmod(0o755)
    assert robot.said("wrong") == f"ddxupdate fails{LOST}"


@pytest.mark.parametrize("proven", ["A", "B", ""])
@pytest.mark.parametrize("first", [bytes(512), b"\xff" * 512, b"# GRUB Environment Block\nslot=Q\n".ljust(512, b"#")],
                         ids=["zeros", "ones", "nonsense"])
def test_a_lost_block_is_restored(robot: Robot, first: bytes, proven: str) -> None:
    """GRUB boots slot A then, and counts nothing. The machine remembers which slot was chosen."""
    robot.state.unlink(missing_ok=True)
    if proven:
        robot.comes_up({"slot": proven, "begun": "1"}, f"ddx.slot={proven} ddx.counted=begun=1")
        robot.state.write_text("later=stays\n" + robot.state.read_text())
    slot = proven or "A"
    after = robot.comes_up_with(first + b"#" * 512, "ddx.slot=A ddx.counted=begun=1")
    assert after == ({"slot": "B"} if slot == "B" else {})
    again = f"slot {slot} is the chosen one again"
    assert robot.said("wrong") == f"the boot loader's block was lost, and slot A booted; {again}\n"
    assert robot.said("failed") == ""
    assert robot.state.read_text() == ("later=stays\n" if proven else "") + f"proven={slot}\n"


def test_an_unproven_slot_is_not_remembered(robot: Robot) -> None:
    robot.comes_up({"begun": "1"}, "ddx.slot=A ddx.counted=begun=1")
    robot.comes_up({"begun": "2"}, "ddx.slot=B ddx.counted=begun=2")
    assert robot.state.read_text().splitlines()[-1] == "proven=A"


@pytest.mark.parametrize("options", [("-F", "12", "-s", "16"), ("-F", "16", "-s", "2"), ("-F", "32", "-s", "1"),
                                     ("-F", "16", "-s", "4", "-R", "8")])
def test_the_block_is_found_on_any_fat(tmp_path: pathlib.Path, options: tuple[str, ...]) -> None:
    """Only the block is changed."""
    card, proc = tmp_path / "card", tmp_path / "proc"
    for name in ("proc", "run", "data"):
        (tmp_path / name).mkdir()
    make_fat(card, {"begun": "1"}, *options, kilobytes=65536 if "32" in options else 16384)
    before = card.read_bytes()
    (proc / "cmdline").write_text("ddx.slot=A ddx.counted=begun=1\n")
    run([native.build() / "usr/libexec/ddx/ddxupdate", "-root", tmp_path, "block", card],
        env={"LD_LIBRARY_PATH": str(library_folder())})
    assert card.read_bytes() == before.replace(text_of({"begun": "1"}), text_of({}))
    assert not (tmp_path / "run/slot.wrong").exists()


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
