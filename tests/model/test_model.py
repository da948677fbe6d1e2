# SPDX-License-Identifier: GPL-2.0-or-later
"""Every interleaving of the two protocols within bounds; and faults, each of which must be found."""
from __future__ import annotations

import os
import pathlib
import re
import subprocess

import pytest

from parts.image import native

pytestmark = [pytest.mark.strict, pytest.mark.computes]

HERE = pathlib.Path(__file__).parent
RING, WORKER = HERE / "ring.pml", HERE / "worker.pml"
SOURCES = HERE.parents[1] / "package/ddx"

# ring.pml
CRASH = {"FRAMES": 3, "TAKES": 2, "CRASHES": 1, "DEATHS": 0, "FIRST": 2}
DEATH = {"FRAMES": 3, "TAKES": 1, "CRASHES": 0, "DEATHS": 1, "FIRST": 1}
NEWCOMER = {"FRAMES": 3, "TAKES": 1, "CRASHES": 0, "DEATHS": 0, "FIRST": 1}
SLEEP = {"FRAMES": 2, "TAKES": 1, "CRASHES": 1, "DEATHS": 0, "FIRST": 2, "SLEEP": 1}
BOTH = {"FRAMES": 2, "TAKES": 1, "CRASHES": 1, "DEATHS": 1, "FIRST": 2}

TORN = "frame=="
FAULTS = [
    # the fault, the bounds within which it is found, the property that it breaks; "": any
    ("NO_ODD_MARK", CRASH, TORN),
    ("NO_FENCE_OF_WRITER", CRASH, TORN),
    ("NO_LOOK_AT_PINS", CRASH, TORN),
    ("NO_RELEASE_OF_FRAME", CRASH, ""),
    ("NO_FENCE_OF_READER", CRASH, TORN),
    ("NO_RECHECK", CRASH, TORN),
    ("NO_RELEASE_OF_PIN", CRASH, TORN),
    ("ANY_WHOLE_FRAME", CRASH, TORN),
    ("UNPUBLISHED_IN_ORDER", CRASH, TORN),
    ("NEWEST_IS_REUSED", CRASH, ""),
    ("LAST_WHOLE_FRAME", CRASH, "number==newest"),
    ("NUMBERS_BEGIN_ANEW", CRASH, "newest"),
    ("NO_CARRY_OVER", CRASH, "newest"),
    ("PIN_OF_FIRST_EPOCH", CRASH, TORN),
    ("FOLLOW_WHILE_HELD", CRASH, TORN),
    ("NO_LOOK_AT_NOTICE", NEWCOMER, TORN),
    ("NOTICE_AFTER_READER", NEWCOMER, TORN),
    ("ONE_SLOT_TOO_FEW", NEWCOMER, "stuck"),
    ("NO_WAKE", SLEEP, "asleep"),
    ("NO_WORD_OF_NEW_EPOCH", SLEEP, "asleep"),
]

# worker.pml
TWICE = {"CRASHES": 2}
MORE = {"CRASHES": 1, "ASKS": 2, "UNREAD": 2}
ITSELF = {"CRASHES": 1, "WRITER_ASKS": 1, "ASKS": 2, "SECOND": 0, "UNREAD": 2}
STOP = {"CRASHES": 1, "STOPS": 1, "UNREAD": 2}
HANGUP = {"CRASHES": 1, "HANGUPS": 1}
STORE = {"CRASHES": 1, "DEATHS": 1}
STORE_ITSELF = {"CRASHES": 1, "DEATHS": 1, "WRITER_ASKS": 1, "SECOND": 0}

WORKER_FAULTS = [
    ("FAULT_DISCARD_BEFORE_COMMIT", {"CRASHES": 1}, "answered[2]=="),
    ("FAULT_SAID_BEFORE_COMMIT", {"CRASHES": 1}, "kept.share[me]==answered[me]"),
    ("FAULT_HANDLED_TWICE", {"CRASHES": 1}, "kept.share[me]==answered[me]"),
    ("FAULT_CLIENT_TAKES_TWICE", {"CRASHES": 1}, "got==heard+1"),
    ("FAULT_QUEUE_FORGOTTEN", {"CRASHES": 1}, ""),
    ("FAULT_NOTICE_BEFORE_READER", {"CRASHES": 0}, "notice<=notice_seen"),
    ("FAULT_NOTICE_GOES_BACK", {"CRASHES": 1, "UNREAD": 2}, "pinned&~known"),
    ("FAULT_NOT_GATED", {"CRASHES": 0}, "pinned&~known"),
    ("FAULT_WRITER_IS_GATED", ITSELF, "answered[0]=="),
    ("FAULT_WAITS_FOR_ROOM", STOP, "invalidendstate"),
    ("FAULT_HUNG_UP_AFTER_COMMIT", HANGUP, "kept.share[1]==answered[1]"),
    ("FAULT_OFFER_WITHOUT_NOTICE", {"CRASHES": 0, "DEATHS": 1}, "pinned&~known"),
]
LARGE = [CRASH, STORE, STORE_ITSELF]  # the search takes longer than to compile the checker with -O1
FAULTS_OF: dict[pathlib.Path, list[tuple[str, dict[str, int], str]]] = {RING: FAULTS, WORKER: WORKER_FAULTS}
BOUNDS_OF = {RING: [CRASH, SLEEP], WORKER: [ITSELF, STOP, HANGUP, STORE]}


def check(folder: pathlib.Path, model: pathlib.Path, bounds: dict[str, int], *faults: str, optimise: str = "-O0",
          cycles: bool = False) -> str:
    """The checker's output; it stops at the first error."""
    defines = [f"-D{name}={value}" for name, value in bounds.items()] + [f"-D{fault}" for fault in faults]
    subprocess.run(["spin", *defines, "-a", model], cwd=folder, check=True, stdout=subprocess.DEVNULL)
    # SAFETY: no search for cycles; NP: any cycle without progress is an error. The limit is in megabytes.
    subprocess.run(["ccache", "gcc", optimise, "-w", "-DNP" if cycles else "-DSAFETY", "-DNOFAIR", "-DVECTORSZ=512",
                    "-DMEMLIM=2500", "-c", "pan.c", "-o", "pan.o"], cwd=folder, check=True,
                   env={**os.environ, **native.CCACHE, "CCACHE_BASEDIR": str(folder)})
    subprocess.run(["gcc", "pan.o", "-o", "pan"], cwd=folder, check=True)
    done = subprocess.run(["./pan", "-m20000", "-w23", "-n", *(["-l"] if cycles else [])], cwd=folder,
                          capture_output=True, text=True, timeout=1200, check=False)
    assert "out of memory" not in done.stdout and "max search depth too small" not in done.stdout, done.stdout
    return done.stdout


def errors(output: str) -> int:
    found = re.search(r"errors: (\d+)", output)
    assert found, output
    return int(found[1])


def holds(output: str) -> None:
    assert errors(output) == 0, output
    found = re.search(r"(\d+) states, stored", output)
    assert found and int(found[1]) > 10000


def is_found(output: str, broken: str) -> None:
    assert errors(output) == 1, output
    found = re.search(r"pan:1: (assertion violated .*|invalid end state) \(at depth", output)
    assert found and broken in re.sub(r"[ ()]", "", found[1]), output


@pytest.mark.parametrize("bounds", [CRASH, DEATH, NEWCOMER, SLEEP, BOTH],
                         ids=["crash", "death", "newcomer", "sleep", "both"])
def test_the_protocol_holds(tmp_path: pathlib.Path, bounds: dict[str, int]) -> None:
    holds(check(tmp_path, RING, bounds, optimise="-O1" if bounds in LARGE else "-O0"))


@pytest.mark.parametrize("bounds", [TWICE, MORE, ITSELF, STOP, HANGUP, STORE, STORE_ITSELF],
                         ids=["twice", "more", "itself", "stop", "hangup", "store", "store-itself"])
def test_the_succession_holds(tmp_path: pathlib.Path, bounds: dict[str, int]) -> None:
    holds(check(tmp_path, WORKER, bounds, optimise="-O1" if bounds in LARGE else "-O0"))


def test_the_succession_ends(tmp_path: pathlib.Path) -> None:
    """There is no endless loop, so each message is sent and each reader admitted in the end."""
    holds(check(tmp_path, WORKER, {"CRASHES": 1}, cycles=True))


@pytest.mark.parametrize("fault, bounds, broken", FAULTS, ids=[fault for fault, _, _ in FAULTS])
def test_each_fault_is_found(tmp_path: pathlib.Path, fault: str, bounds: dict[str, int], broken: str) -> None:
    is_found(check(tmp_path, RING, bounds, fault), broken)


@pytest.mark.parametrize("fault, bounds, broken", WORKER_FAULTS, ids=[fault for fault, _, _ in WORKER_FAULTS])
def test_each_fault_of_succession_is_found(tmp_path: pathlib.Path, fault: str, bounds: dict[str, int],
                                           broken: str) -> None:
    is_found(check(tmp_path, WORKER, bounds, fault), broken)


@pytest.mark.parametrize("model", [RING, WORKER], ids=["ring", "worker"])
def test_each_fault_of_the_model_is_listed(model: pathlib.Path) -> None:
    bounds = {name for run in BOUNDS_OF[model] for name in run}
    used = set(re.findall(r"^#\s*(?:ifn?def|elif defined) (\w+)", model.read_text(), re.M)) - bounds
    assert used == {fault for fault, _, _ in FAULTS_OF[model]}


@pytest.mark.parametrize("path", [RING, WORKER], ids=["ring", "worker"])
def test_the_model_speaks_of_functions_that_exist(path: pathlib.Path) -> None:
    model = path.read_text()
    own = set(re.findall(r"^(?:inline|active.* proctype) (\w+)\(", model, re.M)) | {"atomic_store"}
    named = set(re.findall(r"\b([a-z]\w{3,})\(\)?", " ".join(re.findall(r"/\*.*?\*/", model, re.S)))) - own
    code = "\n".join(path.read_text() for path in SOURCES.glob("*/*.c"))
    assert len(named) > 15
    assert not [name for name in named if not re.search(rf"^\S.*\b{name}\(", code, re.M)]
