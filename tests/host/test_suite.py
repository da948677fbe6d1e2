# SPDX-License-Identifier: GPL-2.0-or-later
"""The test runner: second runs, the summary, and that a run without results does not pass."""
from __future__ import annotations

import os
import pathlib
import re
import shutil
import tempfile
from collections.abc import Sequence

import pytest

from parts.common import TOP, run
from parts.testing import suite
from parts.testing.suite import Suite

pytestmark = pytest.mark.retry

# Fails with these words on its first run in a folder.
ONCE = """\
import pathlib, pytest
@pytest.mark.retry
def test_it():
    mark = pathlib.Path(__file__).with_name("mark")
    again = mark.exists()
    mark.touch()
    assert again, {words!r}
"""
LEAST = 19  # the highest nice value
PRIORITIES = """\
import os, pytest
pytestmark = pytest.mark.retry
@pytest.mark.computes
def test_one():
    assert os.nice(0) == {later}
def test_another():
    assert os.nice(0) == {usual}
"""
MESON = """\
project('x')
sh = find_program('sh')
once = 'test -e @0@ || { touch @0@; echo @1@; exit 1; }'
test('sleeps', sh, args: ['-c', once.format('@folder@/a', 'too late')])
test('tears', sh, args: ['-c', once.format('@folder@/b', 'torn: frame 7').replace('exit 1', 'exit 3')])
test('always', sh, args: ['-c', 'true'])
test('never', sh, args: ['-c', 'echo begins; echo no hardware >&2; exit 77'])
"""


@pytest.fixture
def places(tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> pathlib.Path:
    """Separate result files, so that those of the current run are not touched."""
    for name in ("TEST", "FAILED", "RESULTS"):
        monkeypatch.setattr(suite, name, tmp_path / "out" if name == "TEST" else tmp_path / "out" / name.lower())
    monkeypatch.setattr(suite, "OUTPUT", tmp_path)
    return tmp_path


def run_python(places: pathlib.Path, words: str, source: str = ONCE, strict: bool = False,
               options: Sequence[str] = ()) -> Suite:
    # Below our root, so that a test's name leads to its file.
    with tempfile.TemporaryDirectory(prefix="suite-", dir=TOP / "output") as name:
        folder = pathlib.Path(name)
        shutil.copy(TOP / "tests/conftest.py", folder)
        (folder / "test_once.py").write_text(source.format(words=words))
        result = Suite(strict=strict)
        with result.part("python"):
            result.pytest([], ["-q", *options, str(folder)])
        return result


def outcomes(result: Suite) -> list[str]:
    return [test.outcome for test in result.tests]


def test_a_second_run_is_reported_as_flaky(places: pathlib.Path, capsys: pytest.CaptureFixture[str]) -> None:
    result = run_python(places, "it came too late")
    assert outcomes(result) == ["flaky"]
    assert result.verdict(places / "flaky.txt") == 0
    last = capsys.readouterr().out.splitlines()
    assert last[-2].startswith("FLAKY ") and "it came too late" in last[-2]
    assert last[-1] == "1 passed, 0 failed, 0 skipped"
    assert "it came too late" in (places / "flaky.txt").read_text()
    assert "python" in result.table()


@pytest.mark.parametrize("judged, outcome", [
    ("assert again, 'some were missing'", "failed"),
    ("if not again: raise OSError('some: the guest did not come up')", "flaky")])
def test_no_second_run_for_assertions_of_strict_tests(places: pathlib.Path, judged: str, outcome: str) -> None:
    """An assertion, not an error of the machine; the test's marker counts, not the text of the failure."""
    source = ONCE.replace("mark.retry", "mark.strict").replace("assert again, {words!r}", judged)
    result = run_python(places, "", source)
    assert outcomes(result) == [outcome]
    kept = list((places / "out/failed").iterdir())
    assert len(kept) == 1 and "some" in kept[0].read_text()


def test_a_test_without_marker_is_not_collected(places: pathlib.Path, capfd: pytest.CaptureFixture[str]) -> None:
    """A new test on frames, whose marker was forgotten, would get a second chance."""
    result = run_python(places, "", ONCE.replace("@pytest.mark.retry\n", ""))
    assert outcomes(result) == ["failed"] and result.verdict(places / "flaky.txt") == 1
    assert "neither strict nor retry" in "".join(capfd.readouterr())


def test_no_second_run_when_strict(places: pathlib.Path) -> None:
    assert outcomes(run_python(places, "it came too late", strict=True)) == ["failed"]


def test_outcomes_of_c_tests(places: pathlib.Path, capsys: pytest.CaptureFixture[str]) -> None:
    source, build = places / "source", places / "desk/x"
    source.mkdir()
    (source / "meson.build").write_text(MESON.replace("@folder@", str(places)))
    run(["meson", "setup", build, source])
    result = Suite()
    result.meson("desk", "x", {}, beside=True)
    assert "torn: frame 7" in capsys.readouterr().out  # output is shown also if other parts run at the same time
    assert {test.name.rsplit(": ")[-1]: test.outcome for test in result.tests} == {
        "sleeps": "flaky", "tears": "failed", "always": "passed", "never": "skipped"}
    assert [test.reason for test in result.tests if test.reason] == ["no hardware"]
    assert result.verdict(places / "flaky.txt") == 1
    assert "\nSKIPPED desk: x: never: no hardware\n" in capsys.readouterr().out


@pytest.mark.skipif(os.geteuid() != 0, reason="only root gets a priority back")
def test_tests_that_compute_have_less_priority() -> None:
    with tempfile.TemporaryDirectory(prefix="suite-", dir=TOP / "output") as name:
        folder = pathlib.Path(name)
        shutil.copy(TOP / "tests/conftest.py", folder)
        usual = min(os.nice(0) + 3, LEAST)  # this suite may run under nice
        (folder / "test_it.py").write_text(PRIORITIES.format(usual=usual, later=min(usual + 10, LEAST)))
        run(["nice", "-n", "3", "/usr/bin/python3", "-B", "-m", "pytest", folder], cwd=TOP)


def test_test_names_do_not_contain_their_group() -> None:
    assert suite.plain("tests/boot/test_x.py::test_it[a@b]@test_x.py bios") == "tests/boot/test_x.py::test_it[a@b]"
    assert suite.plain("tests/x.py::test_it[a@b]") == "tests/x.py::test_it[a@b]"


def test_a_run_without_results_fails(places: pathlib.Path, capsys: pytest.CaptureFixture[str]) -> None:
    result = Suite()
    result.pytest([], ["--no-such-option"])
    assert outcomes(result) == ["failed"] and result.verdict(places / "flaky.txt") == 1
    assert Suite().verdict(places / "flaky.txt") == 1
    assert "no test has a name that matches" in capsys.readouterr().out


def test_a_test_that_exits_its_process_has_failed(places: pathlib.Path) -> None:
    """pytest-xdist goes on with another process, and the exit status is the usual one of a failure."""
    source = "import os, pytest\n@pytest.mark.retry\ndef test_exit(): os._exit(0)\n"
    result = run_python(places, "", source, strict=True, options=["-n", "1"])
    assert outcomes(result) == ["failed"] and result.verdict(places / "flaky.txt") == 1
    assert result.tests[0].name.endswith("::test_exit") and "crashed" in result.tests[0].failure


def test_a_test_that_hangs_fails(places: pathlib.Path) -> None:
    source = "import subprocess, pytest\n@pytest.mark.retry\ndef test_hangs(): subprocess.run(['sleep', '4747'])\n"
    result = run_python(places, "", source, strict=True, options=["-n", "1", "--limit", "1"])
    assert outcomes(result) == ["failed"] and "sleep 4747" in result.tests[0].failure


def test_a_test_that_hangs_for_ever_is_named(places: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As one does that waits for the kernel."""
    monkeypatch.setattr(suite, "LIMIT", 5)
    source = ("import signal, time, pytest\n@pytest.mark.retry\ndef test_hangs():\n"
              "    signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGALRM, signal.SIGTERM])\n    time.sleep(60)\n")
    result = run_python(places, "", source, strict=True)
    assert outcomes(result) == ["failed"]
    assert re.search(r"not finished: .*test_once.py::test_hangs, stopped after 5 s", result.tests[0].failure)


def test_c_tests_skip_with_a_reason() -> None:
    sources = {path: path.read_text() for path in (TOP / "tests").rglob("*.[ch]")}
    found = {path.name for path, text in sources.items() if re.search(r"(exit|return)\b.*\b77\b", text)}
    assert found == {"check.h"}, "use SKIP(reason)"


def test_a_sanitizer_s_report_is_a_failure(places: pathlib.Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Also of a program that a test starts, and even if the test passes."""
    source, build = places / "source", places / "address/x"
    source.mkdir()
    (source / "meson.build").write_text("project('x')\ntest('overruns', find_program('sh'), args: ['-c', "
                                        "'echo heap-buffer-overflow > ${ASAN_OPTIONS##*log_path=}.7'])\n")
    run(["meson", "setup", build, source])
    result = Suite()
    result.meson("address", "x", {})
    assert outcomes(result) == ["passed", "failed"] and "heap-buffer-overflow" in capsys.readouterr().out
    assert result.tests[1].name == "address: x: sanitizer"
