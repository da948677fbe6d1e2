# SPDX-License-Identifier: GPL-2.0-or-later
"""`make test-long T=updatecut`: no power cut during updates leaves a disk that GRUB boots into half a version. A guest
writes versions, starts them, keeps and takes back, and all its writes are logged. What grub.cfg makes of each possible
disk is judged by its text (menu()); STATES= of them (default: 150 for each firmware) are booted by GRUB up to the first
line of our scripts, the version, and have to agree. A run that was stopped continues (output/updatecut)."""
import collections
import functools
import pathlib
import random
import re
from collections.abc import Iterator
from os import environ

import pytest

from lib import update_cut
from lib.boot_block import BYTES, Block, block_of, menu
from lib.figures import Figure
from lib.update_cut import Cuts, State
from parts.common import OUTPUT, PATIENCE, copy, scratch
from parts.disk.blocklog import SECTOR, Writes
from parts.disk.disk import BOOT, BOOT_BYTES, Disk
from parts.guest import testdisk
from parts.guest.machine import Machine
from parts.guest.qemu import USERSPACE, Guest
from parts.image import native
from parts.testing.campaign import Campaign, Result

from . import slot_image
from .test_slots import SLOT, SLOT_BYTES

pytestmark = [pytest.mark.retry, pytest.mark.long]

STATES = int(environ.get("STATES") or 150)
WORK = OUTPUT / "updatecut"
END = SLOT["B"] + SLOT_BYTES
VERSIONS = ("0.0.1 (running)", "0.0.2 (former)", "0.0.3 (new)", "0.0.4 (newer)")
RUNNING, FORMER, NEW, NEWER = VERSIONS
STEP = 64  # sectors
HEAD = b"# GRUB Environment Block\n"


@functools.cache
def _menu(items: tuple[tuple[str, str], ...]) -> tuple[Block, str]:
    return menu(dict(items))[:2]


def chosen(block: Block) -> str:
    return _menu(tuple(block.items()))[1]


def short_trial(root: pathlib.Path) -> None:
    (root / "etc/ddx/trial").write_text("good=15\ndeadline=900\nwatchdog=300\n")


def long_trial(root: pathlib.Path) -> None:
    """The trial is decided by hand."""
    (root / "etc/ddx/trial").write_text("good=900\ndeadline=900\nwatchdog=300\n")


class Recording:
    """A guest's disk before the updates, and all that it wrote to it."""

    def __init__(self, name: str) -> None:
        self.folder = WORK / name
        self.log, self.disk = self.folder / "writes.log", self.folder / "before/disk.qcow2"
        self.roots = {version: self.folder / f"{version.split()[0]}.squashfs" for version in VERSIONS}

    def make_roots(self, root: pathlib.Path) -> None:
        for version, path in self.roots.items():
            slot_image.make(root, path, short_trial if version == NEW else long_trial, version)

    def before(self) -> bytes:
        return Disk(self.disk, self.disk.parent).read(0, END)

    def take(self, image: pathlib.Path, accel: str, board: Machine, root: pathlib.Path) -> None:
        self.make_roots(root)
        updates = {}
        for name, version in (("new", NEW), ("newer", NEWER)):
            updates[f"{name}.update"] = slot_image.sign(self.roots[version], self.folder / f"{name}.update")

        def fill(disk: Disk) -> None:
            disk.write(SLOT["A"], self.roots[RUNNING].read_bytes())
            disk.write(SLOT["B"], self.roots[FORMER].read_bytes())
            self.disk.parent.mkdir(exist_ok=True)
            copy(disk.path, self.disk)

        with Guest(image, accel, board, log=self.folder / "console.log", prepare=fill, writes=self.log,
                   test_disk=testdisk.make(self.folder / "updates.img", None, updates),
                   extra=("-action", "reboot=reset")) as guest:
            update(guest)
            guest.process.terminate()  # completes the log
            guest.process.wait(PATIENCE)

    def cuts(self) -> Cuts:
        """Only as much of a slot is looked at as a version takes."""
        before, size = self.before(), max(path.stat().st_size for path in self.roots.values())
        # A file begins at a sector; one of GRUB's modules has the same words elsewhere.
        begin, = (at for at in range(BOOT, BOOT + BOOT_BYTES, SECTOR) if before.startswith(HEAD, at))
        return Cuts(before, begin, self.log, STEP, {name: (at, size) for name, at in SLOT.items()})


def update(guest: Guest) -> None:
    """Kept, back by hand after that, taken back in the trial; then the other slot is written, and kept by hand."""
    boots = 1

    def restarts(command: str, slot: str) -> None:
        nonlocal boots
        guest.shell().begin(command)
        boots += 1
        slot_image.wait_for_boots(guest, boots)
        guest.shell()
        assert f"ddx.slot={slot}" in guest.sh("cat /proc/cmdline").split()

    def decided(how: str) -> None:
        guest.wait_until(f"ddxctl update status --json | grep -q '\"last\":\"{how}\"'")

    guest.shell()
    guest.wait_until("grep -q proven=A /data/update")
    guest.sh("ddxctl update /test/new.update", PATIENCE)
    restarts("ddxctl update start", "B")
    decided("kept")
    restarts("ddxctl update back", "A")
    guest.wait_until("ddxctl health | grep -q 'this version is on trial'")
    restarts("ddxctl update back", "B")
    guest.wait_until("[ -e /run/slot.failed ]")
    decided("returned")
    guest.sh("ddxctl update seen; ddxctl update /test/newer.update", PATIENCE)
    restarts("ddxctl update start", "A")
    guest.wait_until("ddxctl health | grep -q 'this version is on trial'")
    guest.sh("ddxctl update keep; sync")


Key = tuple[bool, bool, str]


def kind(state: State, lost: bool) -> Key:
    """States of a kind differ in nothing that GRUB looks at before it reads the kernel."""
    has_kernel = {name: slot.startswith(update_cut.MAGIC) for name, slot in state.slots.items()}
    return has_kernel["A"], has_kernel["B"], str(None if lost else block_of(state.block))


def different(cuts: Cuts) -> Iterator[tuple[int, Writes, str]]:
    """All cuts, but one of those between two flushes without a write."""
    quiet = False
    for number, (written, how) in enumerate(cuts.cuts()):
        before, quiet = quiet, not cuts.disk.all_written()
        if written or not quiet or not before:
            yield number, written, how


def judge(recording: Recording, states: int) -> Result:
    """All states by the menu's text, and which of them are to be booted: of each kind, in turn."""
    cuts, count, found = recording.cuts(), 0, list[str]()
    whole = {version: path.read_bytes() for version, path in recording.roots.items()}
    kinds: dict[Key, list[tuple[int, bool]]] = collections.defaultdict(list)
    strays = cuts.strays([(cuts.block_at, BYTES), *((at, SLOT_BYTES) for at in SLOT.values())])
    for number, written, how in different(cuts):
        state = cuts.state(written, how)
        count += 1
        found += update_cut.wrong(state, chosen, list(whole.values()), firm=True)
        for lost in (False, True):
            kinds[kind(state, lost)].append((number, lost))
    chance = random.Random(7)
    for one in kinds.values():
        chance.shuffle(one)
    turns = max(map(len, kinds.values()))
    order = [one[turn] for turn in range(turns) for one in kinds.values() if turn < len(one)]
    end = cuts.state(cuts.disk.all_written(), "at the end")
    return {"states": count, "kinds": len(kinds), "wrong": found[:9], "strays": strays, "boot": order[:states],
            "end": [block_of(end.block), *(version_of(slot, whole) for slot in end.slots.values())]}


def version_of(slot: bytes, whole: dict[str, bytes]) -> str:
    return next((version for version, root in whole.items() if slot.startswith(root)), "")


def boot_it(image: pathlib.Path, accel: str, board: Machine, log: pathlib.Path, at: int) -> tuple[str, Block | None]:
    """The version that comes up, and the boot loader's block then."""
    with scratch(WORK) as folder:
        with Guest(image, accel, board, console=False, keep=folder, log=log, processors=1) as guest:
            guest.wait_for_log(USERSPACE)
            said = guest.log.read_text(errors="replace")
        block = block_of(Disk(image, folder).read(at, BYTES))
    versions = re.findall(r"DDXVIDEO (\d\S* \(\w+\))", said)
    return versions[-1] if versions else said[-500:], block


def chosen_states(cuts: Cuts, numbers: list[tuple[int, bool]]) -> Iterator[tuple[str, Writes, State, bool]]:
    """With the name of each one's step."""
    wanted = collections.defaultdict(list)
    for number, lost in numbers:
        wanted[number].append(lost)
    for number, (written, how) in enumerate(cuts.cuts()):
        for lost in wanted[number] if number in wanted else []:
            more = [*written, (cuts.block_at, bytes(BYTES))] if lost else written
            yield f"{number}{' lost' if lost else ''}", more, cuts.state(more, how), lost


def test_states_boot_by_grub(image: pathlib.Path, root: pathlib.Path, accel: str, board: Machine,
                             record_property: Figure) -> None:
    slot_image.skip_unless_updates(root)
    name = f"{board.board}-{board.firmware}"
    recording = Recording(name)
    steps = Campaign(WORK / f"{name}.jsonl", [image, native.build()], [recording.folder], states=STATES)
    recording.folder.mkdir(exist_ok=True)
    steps.once("recorded", lambda: recording.take(image, accel, board, root))
    judged = steps.once("judged", lambda: judge(recording, STATES))
    for name in ("states", "kinds"):
        record_property(name, judged[name])
    assert (judged["wrong"], judged["strays"], judged["end"]) == ([], [], [{}, NEWER, NEW])
    whole = {version: path.read_bytes() for version, path in recording.roots.items()}
    cuts, disk, wrong = recording.cuts(), recording.folder / "disk.img", list[str]()
    for step, written, state, lost in chosen_states(cuts, judged["boot"]):
        block = block_of(state.block)
        expected = (version_of(state.slots[update_cut.booted(state, chosen)[1]], whole),
                    None if block is None else _menu(tuple(block.items()))[0])
        if step not in steps.results:
            cuts.disk.make(disk, written)
            with disk.open("r+b") as file:
                file.truncate(image.stat().st_size)
            steps.add(step, boot_it(disk, accel, board, recording.folder / "boot.log", cuts.block_at))
        if steps.results[step] != list(expected):
            wrong.append(f"{state.how}{', block zeroed' if lost else ''}: {steps.results[step]}, not {expected}")
    record_property("booted", len(judged["boot"]))
    assert not wrong, f"{len(wrong)} of {len(judged['boot'])} states: {wrong[:5]}"
