# SPDX-License-Identifier: GPL-2.0-or-later
"""The slot protocol, every interleaving of it within bounds; and faults, each of which must be found."""
from __future__ import annotations

import pathlib
import re
import subprocess

import pytest

MODEL = pathlib.Path(__file__).with_name("ring.pml")
SOURCES = MODEL.parents[2] / "package/ddx"

CRASH = {"FRAMES": 3, "TAKES": 2, "CRASHES": 1, "DEATHS": 0, "FIRST": 2}
DEATH = {"FRAMES": 3, "TAKES": 1, "CRASHES": 0, "DEATHS": 1, "FIRST": 1}
NEWCOMER = {"FRAMES": 3, "TAKES": 1, "CRASHES": 0, "DEATHS": 0, "FIRST": 1}
SLEEP = {"FRAMES": 2, "TAKES": 1, "CRASHES": 1, "DEATHS": 0, "FIRST": 2, "SLEEP": 1}
BOTH = {"FRAMES": 2, "TAKES": 1, "CRASHES": 1, "DEATHS": 1, "FIRST": 2}

TORN = "frame=="
FAULTS = [
    # what is left out or wrong, the bounds within which it shows, the property that it breaks; "": one or another
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


def check(folder: pathlib.Path, bounds: dict[str, int], *faults: str, optimise: str = "-O0") -> str:
    """What the checker says; it ends at the first error."""
    defines = [f"-D{name}={value}" for name, value in bounds.items()] + [f"-D{fault}" for fault in faults]
    subprocess.run(["spin", *defines, "-a", MODEL], cwd=folder, check=True, stdout=subprocess.DEVNULL)
    # NOFAIR, SAFETY: no cycles are looked for. The limit is megabytes.
    subprocess.run(["gcc", optimise, "-w", "-DSAFETY", "-DNOFAIR", "-DVECTORSZ=512", "-DMEMLIM=2500", "pan.c", "-o",
                    "pan"], cwd=folder, check=True)
    done = subprocess.run(["./pan", "-m20000", "-w23", "-n"], cwd=folder, capture_output=True, text=True, timeout=1200,
                          check=False)
    assert "out of memory" not in done.stdout and "max search depth too small" not in done.stdout, done.stdout
    return done.stdout


def errors(output: str) -> int:
    found = re.search(r"errors: (\d+)", output)
    assert found, output
    return int(found[1])


@pytest.mark.parametrize("bounds", [CRASH, DEATH, NEWCOMER, SLEEP, BOTH],
                         ids=["crash", "death", "newcomer", "sleep", "both"])
def test_the_protocol_holds(tmp_path: pathlib.Path, bounds: dict[str, int]) -> None:
    output = check(tmp_path, bounds, optimise="-O2")
    assert errors(output) == 0, output
    found = re.search(r"(\d+) states, stored", output)
    assert found and int(found[1]) > 10000


@pytest.mark.parametrize("fault, bounds, broken", FAULTS, ids=[fault for fault, _, _ in FAULTS])
def test_each_fault_is_found(tmp_path: pathlib.Path, fault: str, bounds: dict[str, int], broken: str) -> None:
    output = check(tmp_path, bounds, fault)
    assert errors(output) == 1, output
    found = re.search(r"pan:1: assertion violated (.*) \(at depth", output)
    assert found and broken in re.sub(r"[ ()]", "", found[1]), output


def test_each_fault_of_the_model_is_listed() -> None:
    bounds = {name for run in (CRASH, SLEEP) for name in run}
    used = set(re.findall(r"^#\s*ifn?def (\w+)", MODEL.read_text(), re.M)) - bounds
    assert used == {fault for fault, _, _ in FAULTS}


def test_the_model_speaks_of_functions_that_exist() -> None:
    model = MODEL.read_text()
    own = set(re.findall(r"^(?:inline|active.* proctype) (\w+)\(", model, re.M)) | {"atomic_store"}
    named = set(re.findall(r"\b([a-z]\w{3,})\(\)?", " ".join(re.findall(r"/\*.*?\*/", model, re.S)))) - own
    code = "\n".join(path.read_text() for path in SOURCES.glob("*/*.c"))
    assert len(named) > 15
    assert not [name for name in named if not re.search(rf"^\S.*\b{name}\(", code, re.M)]
