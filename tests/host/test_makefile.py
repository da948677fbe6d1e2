# SPDX-License-Identifier: GPL-2.0-or-later
"""The Makefile: a short list of targets in its help, and campaigns as long tests."""
import subprocess

import pytest

from parts.common import TOP


def make(*words: str) -> str:
    return subprocess.run(["make", "-s", *words], cwd=TOP, capture_output=True, text=True, check=True).stdout


def test_help_shows_only_the_common_targets() -> None:
    assert sum(line.startswith("  make ") for line in make("help").splitlines()) == 12


@pytest.mark.parametrize("words, command", [
    (["T=powercut", "ARGS=-cuts 3 -seed 2"], "tools/powercut.py -cuts 3 -seed 2"),
    (["T=bench-record"], "tools/bench_record.py"),
    (["T=reproduce", "BOARD=pc104"], 'tools/buildroot.py reproduce "pc104"'),
    (["T=test_powercut"], "tools/gate.py -long 'test_powercut'"),
    (["T=crash or killed"], "tools/gate.py -long 'crash or killed'"),
    ([], "tools/gate.py -long")])
def test_campaigns_and_long_tests_share_a_target(words: list[str], command: str) -> None:
    last = " ".join(make("-n", "test-long", *words).splitlines()[-1].split())
    assert last == f"/usr/bin/python3 -B {command}"
    assert (TOP / command.split()[0]).exists()


def test_each_campaign_named_in_help_exists() -> None:
    line = next(line for line in make("help").splitlines() if "make test-long" in line)
    for name in line.split("T=")[1].split(":")[0].split(", "):
        assert "gate.py" not in make("-n", "test-long", f"T={name}")
