# SPDX-License-Identifier: GPL-2.0-or-later
"""confine: a program of root's keeps only the listed capabilities."""
from __future__ import annotations

import os
import re
import subprocess

import pytest

from .programs import ROOT

pytestmark = pytest.mark.retry

STATUS = ("cat", "/proc/self/status")


def confine(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([ROOT / "libexec/ddx/confine", *words], capture_output=True, text=True, check=False)


@pytest.mark.parametrize("names, bits", [("sys_time", 1 << 25), ("net_admin,net_raw", 1 << 12 | 1 << 13)])
def test_a_program_has_only_these_capabilities(names: str, bits: int) -> None:
    if os.geteuid() != 0:
        pytest.skip("needs root")
    done = confine(names, "sh", "-c", " ".join(STATUS))  # nor has any program that it starts
    found = dict(re.findall(r"^(Cap\w+|NoNewPrivs):\t(\w+)$", done.stdout, re.M))
    assert {int(found[kind], 16) for kind in ("CapPrm", "CapEff", "CapBnd")} == {bits}, done
    assert int(found["CapAmb"], 16) == 0 and found["NoNewPrivs"] == "1"


@pytest.mark.parametrize("words", [(), ("sys_time",), ("", *STATUS), ("sys_admin", *STATUS), ("sys_time,all", *STATUS)])
def test_wrong_usage_runs_nothing(words: tuple[str, ...]) -> None:
    done = confine(*words)
    assert done.returncode == 2 and done.stdout == "" and done.stderr.startswith("usage: confine net_admin|")
