# SPDX-License-Identifier: GPL-2.0-or-later
"""The defects of tests/defects: all patches apply to the sources, and tests find those with a switch."""
from __future__ import annotations

import pathlib
import re
import shutil

import pytest

from defects import noticed
from parts.common import TOP, Failed
from parts.defects import DEFECTS, Defect, plant

pytestmark = pytest.mark.retry


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


def test_each_named_test_exists() -> None:
    """Otherwise `make defects` would find out late."""
    c_names = set(re.findall(r"'([^'\n]+)'", (TOP / "tests/meson.build").read_text()))
    for one in DEFECTS:
        assert one.switched or one.tests, one.name
        for test, _ in one.tests:
            file, _, function = test.partition("::")
            if test.startswith("C: "):
                assert test.removeprefix("C: ") in c_names, one.name
            elif file.endswith(".py"):
                assert f"def {function}(" in (TOP / file).read_text() if function else (TOP / file).exists(), one.name


@pytest.mark.parametrize("defect, test, words", [
    pytest.param(one, test, words, id=f"{one.name}-{pathlib.Path(test.split()[0]).name}")
    for one in DEFECTS if one.switched for test, words in one.tests if not test.startswith("fuzz: ")])
def test_a_switched_defect_is_found(defect: Defect, test: str, words: str) -> None:
    assert noticed(defect, test, words)
