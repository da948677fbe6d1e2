# SPDX-License-Identifier: GPL-2.0-or-later
"""The fuzz targets find nothing in a short time, and find defects that are put in. `make test-long T=fuzz` takes
longer."""
from __future__ import annotations

import pathlib
import re

import pytest

import fuzz
from parts.defects import DEFECTS

pytestmark = [pytest.mark.computes, pytest.mark.strict]

SECONDS = 5  # for each target; all fuzzing of `make test` together stays within 5 minutes
SHORTER = {"report": 2, "sap": 2}  # small readers
SEED = 1     # one that finds each defect soon; tools/fuzz.py looks for new faults


@pytest.mark.parametrize("target", fuzz.ALL)
def test_nothing_is_found(target: str) -> None:
    fine, text = fuzz.fuzz(target, SHORTER.get(target, SECONDS), seed=SEED)
    assert fine, text[-5000:]
    executed = [int(line.split()[-1]) for line in text.splitlines() if "number_of_executed_units" in line]
    corpus = [path for folder in fuzz.seeds(target) for path in folder.iterdir()]
    assert executed and executed[0] > 10 * len(corpus)  # it did go beyond what is committed


@pytest.mark.parametrize("name, target, words", [
    pytest.param(one.name, test.removeprefix("fuzz: "), words, id=one.name)
    for one in DEFECTS for test, words in one.tests if test.startswith("fuzz: ")] + [
    pytest.param("rtps-broken", fuzz.FOREIGN, r"AddressSanitizer(?s:.)*validate_AckNack", id="rtps-broken")])
def test_a_defect_is_found(name: str, target: str, words: str, tmp_path: pathlib.Path) -> None:
    fine, text = fuzz.fuzz(target, 60, name, corpus=tmp_path, seed=SEED)
    assert not fine and re.search(words, text), text[-5000:]
