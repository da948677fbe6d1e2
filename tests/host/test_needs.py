# SPDX-License-Identifier: GPL-2.0-or-later
"""The packages that the tools need are in the part of the list that their target installs."""
from __future__ import annotations

import pathlib
import subprocess
import sys

import pytest

from parts import common
from parts.release import needs

pytestmark = pytest.mark.retry


@pytest.mark.computes
def test_a_package_in_a_part_that_a_target_does_not_install_is_named() -> None:
    """Both were once: `make run` failed after four minutes without fdisk, fuzzing named no function without llvm."""
    lists = needs.parts()
    lists["run"].remove("fdisk")
    lists["test"] -= {"llvm", "python3-lz4"}
    lists["test"].add("fdisk")
    found = list(needs.complaints(lists))
    no_part = "is in no part of tools/debian-packages.txt that the target installs"
    assert f"make run: tools/parts/disk/mbr.py starts sfdisk: fdisk {no_part}" in found
    assert f"make flash: tools/parts/disk/mbr.py starts sfdisk: fdisk {no_part}" in found
    assert f"make test: tools/fuzz.py starts llvm-symbolizer: llvm {no_part}" in found
    assert [one for one in found if one.startswith("make test: ") and f"imports lz4: python3-lz4 {no_part}" in one]
    assert not [one for one in found if "make test:" in one and "sfdisk" in one]


def test_a_program_of_no_known_package_is_named(tmp_path: pathlib.Path) -> None:
    (tmp_path / "tool.py").write_text('from parts.common import run\nrun(["frobnicate", "-x"])\nrun(["ls"])\n')
    assert needs.unknown(tmp_path / "tool.py") == {"frobnicate"}


def test_a_missing_program_is_reported_with_its_package() -> None:
    script = """
import pathlib, sys
sys.path.insert(0, sys.argv[1])
from parts import common
from parts.disk import mbr
mbr.SBIN["PATH"] = "/nowhere"
common.finish("run", lambda: len(mbr.table(pathlib.Path("disk.img"))))
"""
    done = subprocess.run([sys.executable, "-B", "-c", script, str(common.TOP / "tools")], capture_output=True,
                          text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (
        1, "run: the program sfdisk is not installed: apt install fdisk\n", "")
