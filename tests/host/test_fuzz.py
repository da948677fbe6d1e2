# SPDX-License-Identifier: GPL-2.0-or-later
"""Short runs of the fuzz targets find nothing, and find injected defects. `make test-long T=fuzz` runs longer."""
from __future__ import annotations

import pathlib
import re

import pytest

import fuzz
from parts.defects import DEFECTS

pytestmark = [pytest.mark.computes, pytest.mark.strict]

SECONDS = 5  # for each target; all fuzzing of `make test` together stays within 5 minutes
SHORTER = {"mp4": 2, "panel": 2, "report": 2, "sap": 2, "update": 2}  # small parsers
SEED = 1     # finds each injected defect soon


@pytest.mark.parametrize("target", fuzz.ALL)
def test_fuzzing_finds_no_defect(target: str) -> None:
    fine, text = fuzz.fuzz(target, SHORTER.get(target, SECONDS), seed=SEED)
    assert fine, text[-5000:]
    executed = [int(line.split()[-1]) for line in text.splitlines() if "number_of_executed_units" in line]
    corpus = [path for folder in fuzz.seeds(target) for path in folder.iterdir()]
    # The fuzzer ran inputs beyond the committed corpus. Those of rtps wait for threads, which a busy machine delays.
    assert executed and executed[0] > (1 if target == fuzz.FOREIGN else 10) * len(corpus)


@pytest.mark.parametrize("name, target, words", [
    pytest.param(one.name, test.removeprefix("fuzz: "), words, id=one.name)
    for one in DEFECTS for test, words in one.tests if test.startswith("fuzz: ")] + [
    # In a packet's header; and in a value, which is read only after a participant and its writer are announced. Threads
    # make each run another one: what is too short is found where it is checked, or where it is read later.
    pytest.param("rtps-broken", fuzz.FOREIGN, "AddressSanitizer(?s:.)*(validate_|handle_)?[aA]ck[nN]ack",
                 id="rtps-broken"),
    pytest.param("rtps-value-broken", fuzz.FOREIGN, "AddressSanitizer(?s:.)*(normalize_|serdata|dds_stream)",
                 id="rtps-value-broken")])
def test_fuzzing_finds_an_injected_defect(name: str, target: str, words: str, tmp_path: pathlib.Path) -> None:
    fine, text = fuzz.fuzz(target, 180, name, corpus=tmp_path, seed=SEED)  # it stops when the defect is found
    assert not fine and re.search(words, text), text[-5000:]
