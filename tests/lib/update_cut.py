# SPDX-License-Identifier: GPL-2.0-or-later
"""A small disk with a boot partition, two slots and settings, for power cuts at any write of an update, and what such a
disk boots."""
import dataclasses
import pathlib
import random
from collections.abc import Callable, Iterator, Mapping

from lib.boot_block import BYTES, Block, block_of, make_fat, text_of
from parts.common import TOP, run, scratch
from parts.disk import blocklog
from parts.disk.blocklog import SECTOR, Writes

MIB = 1 << 20
BOOT, SLOTS, DATA = (MIB, 4 * MIB), {"A": (5 * MIB, 3 * MIB), "B": (8 * MIB, 3 * MIB)}, (11 * MIB, 8 * MIB)
SIZE = 20 * MIB
MAGIC = b"hsqs"  # a squashfs begins with it

Menu = Callable[[Block], str]  # the slot that GRUB's menu chooses for such a block


def make_disk(image: pathlib.Path, block: Block, slots: dict[str, bytes]) -> int:
    """Returns where the boot loader's block is."""
    with scratch() as folder:
        boot, data = folder / "boot", folder / "data"
        make_fat(boot, block, "--invariant", kilobytes=BOOT[1] // 1024)
        run(["mcopy", "-i", boot, TOP / "board/common/grub.cfg", "::grub/grub.cfg"])
        run(["truncate", "-s", str(DATA[1]), data])
        run(["mke2fs", "-q", "-b", "1024", "-t", "ext4", "-m", "0", "-E", "lazy_itable_init=0,lazy_journal_init=0",
             data])
        disk = bytearray(SIZE)
        for begin, content in [(BOOT[0], boot.read_bytes()), (DATA[0], data.read_bytes()),
                               *((SLOTS[name][0], content) for name, content in slots.items())]:
            disk[begin:begin + len(content)] = content
    image.write_bytes(disk)
    return disk.index(text_of(block))


@dataclasses.dataclass(frozen=True)
class State:
    """A possible disk after a power cut: the block, both slots, and how it came about."""
    block: bytes
    slots: dict[str, bytes]
    how: str


class Cuts:
    """All states of a disk while its logged writes happened. `before` is the disk's content up to the end of the last
    slot, or more: what is written after that is of no interest."""

    def __init__(self, before: bytes, block_at: int, log: pathlib.Path, step: int,
                 slots: Mapping[str, tuple[int, int]] = SLOTS) -> None:
        """A write of the block or of the first MiB of a slot is cut at each `step`th sector."""
        self.disk, self.block_at, self.step, self.slots = blocklog.LoggedDisk(0, before), block_at, step, slots
        self.entries = [entry for entry in blocklog.entries(log) if entry.offset < len(before)]
        self.chance = random.Random(7)

    def _view(self, begin: int, size: int, written: Writes) -> bytes:
        part = self.disk.safe[begin:begin + size]
        for at, data in written:
            low, high = max(at, begin), min(at + len(data), begin + size)
            if low < high:
                part[low - begin:high - begin] = data[low - at:high - at]
        return bytes(part)

    def state(self, written: Writes, how: str) -> State:
        return State(self._view(self.block_at, BYTES, written),
                     {name: self._view(begin, size, written) for name, (begin, size) in self.slots.items()}, how)

    def _is_sensitive(self, at: int) -> bool:
        return self.block_at <= at < self.block_at + BYTES or any(
            begin <= at < begin + MIB for begin, _ in self.slots.values())

    def _pieces(self, number: int, entry: blocklog.Entry) -> Iterator[tuple[Writes, str]]:
        """The entry's first sectors alone."""
        for size in range(SECTOR, len(entry.data), SECTOR * self.step):
            yield ([*self.disk.all_written(), (entry.offset, entry.data[:size])],
                   f"write {number} at {entry.offset}: its first {size} bytes")

    def cuts(self) -> Iterator[tuple[Writes, str]]:
        """The writes that a cut may leave of those that no flush covered, with a description. For state(), and for the
        disk's make(), until the next one is taken."""
        for number, entry in enumerate(self.entries):
            if entry.data and self._is_sensitive(entry.offset):
                yield from self._pieces(number, entry)
            if not self.disk.add(entry):
                continue
            yield self.disk.all_written(), f"write {number} at {entry.offset}"
            for variant in range(3):
                yield self.disk.some_written(self.chance), f"write {number} at {entry.offset}, variant {variant}"

    def states(self) -> Iterator[State]:
        for written, how in self.cuts():
            yield self.state(written, how)

    def strays(self, allowed: list[tuple[int, int]]) -> list[int]:
        """Writes outside of these ranges, given as offset and size."""
        return [entry.offset for entry in self.entries if entry.data and not any(
            begin <= entry.offset and entry.offset + len(entry.data) <= begin + size for begin, size in allowed)]


def booted(state: State, menu: Menu, lost: bool = False) -> tuple[str, str]:
    """The slot that GRUB's menu chooses, and the one that it boots. `lost`: the block is zeroed."""
    chosen = menu({} if lost else block_of(state.block) or {})
    return chosen, chosen if state.slots[chosen].startswith(MAGIC) else "B" if chosen == "A" else "A"


def wrong(state: State, menu: Menu, whole: list[bytes], firm: bool) -> Iterator[str]:
    """The wrong actions of such a disk. `whole`: contents of a slot that may be booted. `firm`: the chosen
    slot is whole itself; otherwise GRUB may find no kernel there, and boot the other slot."""
    good = {name: any(slot.startswith(one) for one in whole) for name, slot in state.slots.items()}
    for name, slot in state.slots.items():
        if slot.startswith(MAGIC) and not good[name]:
            yield f"{state.how}: slot {name} has a kernel, but is not whole"
    for lost in (False, True):
        chosen, boots = booted(state, menu, lost)
        if not good[boots]:
            yield f"{state.how}{', block zeroed' if lost else ''}: slot {boots} is booted, and is not whole"
        if firm and not lost and not good[chosen]:
            yield f"{state.how}: slot {chosen} is chosen, and is not whole"
