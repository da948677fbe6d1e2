# SPDX-License-Identifier: GPL-2.0-or-later
"""The fuzz targets find nothing in a short time, and find a planted fault. `make test-long T=fuzz` takes longer."""
from __future__ import annotations

import pathlib

import pytest

import fuzz
from parts.common import TOP

pytestmark = [pytest.mark.computes, pytest.mark.strict]

SECONDS = 5  # for each target; all fuzzing of `make test` together stays within 5 minutes
SHORTER = {"report": 2, "sap": 2}  # small readers
SEED = 1     # tools/fuzz.py looks for new faults


@pytest.mark.parametrize("target", fuzz.TARGETS)
def test_nothing_is_found(target: str) -> None:
    fine, text = fuzz.fuzz(target, SHORTER.get(target, SECONDS), seed=SEED)
    assert fine, text[-5000:]
    executed = [int(line.split()[-1]) for line in text.splitlines() if "number_of_executed_units" in line]
    corpus = list((TOP / "tests/fuzz/corpus" / target).iterdir())
    assert executed and executed[0] > 10 * len(corpus)  # it did go beyond what is committed


@pytest.mark.parametrize("target, fault, found", [
    ("rtp", "STAP", ["AddressSanitizer", "unpack_aggregate"]),  # the sizes in an aggregate are believed
    ("repair", "BELIEVE", ["fuzz/repair.c"]),  # so is the length of a restored packet
    ("report", "REPORT", ["AddressSanitizer", "report_parse"]),  # that of an RTCP packet
    ("sap", "SAP", ["AddressSanitizer", "sap_parse"])])  # and that of an authentication
def test_a_planted_fault_is_found(target: str, fault: str, found: list[str], tmp_path: pathlib.Path) -> None:
    fine, text = fuzz.fuzz(target, 60, f"-DDDX_FAULT_{fault}", corpus=tmp_path)
    assert not fine and all(word in text for word in found), text[-5000:]
