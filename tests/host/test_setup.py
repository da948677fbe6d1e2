# SPDX-License-Identifier: GPL-2.0-or-later
"""tools/setup: a line for each step, one line while another apt runs, and apt's own words in a log."""
from __future__ import annotations

import fcntl
import os
import pathlib
import shutil
import subprocess

import pytest

from parts.common import TOP

pytestmark = [pytest.mark.retry, pytest.mark.skipif(os.geteuid() != 0, reason="holds a lock of apt's")]
APT = """#!/bin/sh
echo "$@" >> "$CALLS"
seq 2000
[ "$FAILS" != "$2" ]
"""


def start_setup(tree: pathlib.Path, fails: str = "") -> "subprocess.Popen[str]":
    """tools/setup of a list with one package that no machine has; a script takes the place of apt-get."""
    (tree / "tools").mkdir()
    shutil.copy(TOP / "tools/setup", tree / "tools")
    (tree / "tools/debian-packages.txt").write_text("no-such-package   for nothing\n")
    (tree / "bin").mkdir()
    (tree / "bin/apt-get").write_text(APT)
    (tree / "bin/apt-get").chmod(0o755)
    return subprocess.Popen([tree / "tools/setup"], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
                            env={"PATH": f"{tree}/bin:/usr/bin:/bin", "CALLS": str(tree / "calls"), "FAILS": fails})


def test_another_apt_is_waited_for_with_one_line(tmp_path: pathlib.Path) -> None:
    with open("/var/lib/apt/lists/lock", "a") as lock:
        fcntl.lockf(lock, fcntl.LOCK_EX)
        process = start_setup(tmp_path)
        assert process.stdout
        lines = [process.stdout.readline() for _ in range(2)]
        with pytest.raises(subprocess.TimeoutExpired):  # long enough for two more looks at the lock
            process.wait(2.5)
        assert not (tmp_path / "calls").exists()
    rest, _ = process.communicate(timeout=30)
    assert process.returncode == 0
    assert lines == ["setup: reading Debian's package lists ...\n", "setup: waiting for another apt\n"]
    assert rest.splitlines()[0].startswith("setup: installing no-such-package and what these need ")
    assert len(rest.splitlines()) <= 3
    assert [line.split("DPkg::Lock::Timeout=600 ")[1].split()[0] for line in
            (tmp_path / "calls").read_text().splitlines()] == ["update", "install"]
    assert (tmp_path / "output/setup.log").read_text().splitlines() == [str(one) for one in range(1, 2001)] * 2


def test_a_failure_shows_the_end_of_apt_s_words(tmp_path: pathlib.Path) -> None:
    process = start_setup(tmp_path, fails="-o")
    said, _ = process.communicate(timeout=30)
    assert process.returncode == 1
    lines = said.splitlines()
    assert lines[1:16] == [str(one) for one in range(1986, 2001)]
    assert lines[16] == f"setup: apt-get update failed, see above and {tmp_path}/output/setup.log"
