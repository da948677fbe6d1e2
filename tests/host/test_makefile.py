# SPDX-License-Identifier: GPL-2.0-or-later
"""The Makefile: a short list of targets in its help, and campaigns as long tests."""
import pathlib
import subprocess

import pytest

from parts.common import TOP


def make(*words: str) -> str:
    return subprocess.run(["make", "-s", *words], cwd=TOP, capture_output=True, text=True, check=True).stdout


def test_help_shows_only_the_common_targets() -> None:
    assert sum(line.startswith("  make ") for line in make("help").splitlines()) == 13


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


INNER = ("import sys; sys.path.insert(0, 'tools'); from parts.testing import suite; suite.leave_make(); "
         "import subprocess; subprocess.run(['make', '-s', '-n', 'again', 'C=inner'], check=True)")


def test_words_of_make_do_not_reach_a_make_in_a_test(tmp_path: pathlib.Path) -> None:
    (tmp_path / "Makefile").write_text(f'all:\n\t@cd {TOP} && /usr/bin/python3 -B -c "{INNER}"\n')
    done = subprocess.run(["make", "-s", "-C", tmp_path, "T=outer", "C=outer", "LOAD=1"], capture_output=True,
                          text=True, check=True)
    assert done.stdout.splitlines()[-1].split("again.py", 1)[1].split() == ["-c", "'inner'"]


def test_each_campaign_named_in_help_exists() -> None:
    line = next(line for line in make("help").splitlines() if "make test-long" in line)
    for name in line.split("T=")[1].split(":")[0].split(", "):
        assert "gate.py" not in make("-n", "test-long", f"T={name}")
