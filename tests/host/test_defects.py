# SPDX-License-Identifier: GPL-2.0-or-later
"""The defects of tests/defects: all can be put into the present sources, and those with a switch are noticed."""
from __future__ import annotations

import os
import pathlib
import re
import shutil
import subprocess

import pytest

from parts.common import MORTAL, OUTPUT, TOP, Failed
from parts.defects import DEFECTS, plant

DESK = OUTPUT / "desk"
ATTEMPTS = 3  # some defects show only if processes meet at the wrong moment, and a busy machine lets them miss


def test_all_apply_together(tmp_path: pathlib.Path) -> None:
    for name in {name for one in DEFECTS for name in one.files}:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(TOP / name, tmp_path / name)
    for one in DEFECTS:
        plant(one, tmp_path)


def test_a_patch_that_does_not_apply_is_named(tmp_path: pathlib.Path) -> None:
    changed = tmp_path / DEFECTS[0].files[0]
    changed.parent.mkdir(parents=True)
    changed.write_text("other contents\n")
    with pytest.raises(Failed, match=f"tests/defects/{DEFECTS[0].name}.patch does not apply"):
        plant(DEFECTS[0], tmp_path)


def test_the_product_has_no_switch() -> None:
    found = [str(path.relative_to(TOP)) for path in (TOP / "package").rglob("*.[ch]")
             if re.search(r"ddx_broken|DDX_BROKEN|# *if.*DDX_FAULT_(?!H\b)", path.read_text())]
    assert found == []


@pytest.mark.parametrize("name, test, words", [
    pytest.param(one.name, test, words, id=f"{one.name}-{pathlib.Path(test.split()[0]).name}")
    for one in DEFECTS if one.switched for test, words in one.tests if not test.startswith("fuzz: ")])
def test_a_switched_defect_is_noticed(name: str, test: str, words: str) -> None:
    program, *options = test.split()
    for _ in range(ATTEMPTS):
        done = subprocess.run([*MORTAL, DESK / program, *options], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                              stderr=subprocess.STDOUT, text=True, errors="replace", timeout=120, check=False,
                              env={**os.environ, "DDX_BROKEN": name,
                                   "DDX_STORE_PROGRAM": str(DESK / "ddx/tests/store-with-faults")})
        if done.returncode > 0 and re.search(words, done.stdout):
            return
    raise AssertionError(f"DDX_BROKEN={name} {test}: no {words!r} in: {done.stdout[-5000:]}")
