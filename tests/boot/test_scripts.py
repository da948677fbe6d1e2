# SPDX-License-Identifier: GPL-2.0-or-later
"""The image's shell can parse every script in the image."""
import pathlib
import subprocess

import pytest

from parts.common import TOP

pytestmark = pytest.mark.retry


def test_our_shell_parses_every_script(root: pathlib.Path) -> None:
    scripts = [path for folder in ["etc", "usr"] for path in (root / folder).rglob("*")
               if path.is_file() and not path.is_symlink() and path.open("rb").read(9) == b"#!/bin/sh"]
    assert len(scripts) >= 10
    for path in [*scripts, TOP / "board/dev/init"]:
        done = subprocess.run([root / "bin/busybox", "ash", "-n", path], capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{path.relative_to(TOP)}: {done.stderr}"
