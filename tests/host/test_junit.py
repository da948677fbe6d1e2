# SPDX-License-Identifier: GPL-2.0-or-later
"""`make test JUNIT=file`: read like a CI does."""
from __future__ import annotations

import os
import pathlib
import sys
import xml.etree.ElementTree as xml

import pytest

import gate
from parts.common import Failed
from parts.testing import junit, suite
from parts.testing.suite import Suite

from .test_suite import places

pytestmark = pytest.mark.retry

__all__ = ["places"]
# The schema of Jenkins' xUnit plugin, of which GitLab reads a part.
SUMS = {"name", "time", "tests", "failures", "errors"}
ATTRIBUTES = {"testsuites": SUMS, "testsuite": SUMS | {"skipped", "timestamp"},
              "testcase": {"name", "classname", "time"}, "failure": {"message"}, "skipped": {"message"},
              "system-out": set()}
INSIDE = {"testsuites": {"testsuite"}, "testsuite": {"testcase"}, "testcase": {"failure", "skipped", "system-out"}}


def seconds(element: xml.Element) -> float:
    return float(element.attrib["time"])


def check(element: xml.Element) -> None:
    """Check elements and attributes, and that the sums are those of the contents."""
    for inner in element:
        assert inner.tag in INSIDE.get(element.tag, set()), (element.tag, inner.tag)
        check(inner)
    assert set(element.attrib) == ATTRIBUTES[element.tag], element.attrib
    if element.tag in ("testsuites", "testsuite"):
        cases = list(element.iter("testcase"))
        assert int(element.attrib["tests"]) == len(cases)
        assert int(element.attrib["failures"]) == len(list(element.iter("failure"))) and element.attrib["errors"] == "0"
        assert abs(seconds(element) - sum(map(seconds, cases))) < 0.001 * len(cases) + 0.001
    if element.tag == "testsuite":
        assert int(element.attrib["skipped"]) == len(list(element.iter("skipped")))
        assert len({case.attrib["classname"] for case in element}) == 1


def read(path: pathlib.Path) -> dict[str, tuple[str, str]]:
    """For each test `failed`, `skipped` or `passed`, and why. Names must be unique: a CI identifies tests by them."""
    root = xml.parse(path).getroot()
    assert root.tag == "testsuites"
    check(root)
    found = {}
    for case in root.iter("testcase"):
        kinds = [inner.tag for inner in case]
        assert len(kinds) <= 1
        kind = {"failure": "failed", "skipped": "skipped"}.get(kinds[0] if kinds else "", "passed")
        found[case.attrib["name"]] = kind, case[0].attrib.get("message", case[0].text or "") if kinds else ""
    assert len(found) == len(list(root.iter("testcase")))
    return found


def test_tests_of_all_kinds(places: pathlib.Path) -> None:
    run, path = Suite(), junit.target(str(places / "deep/er/it.xml"))
    with junit.written(path, run):
        run.take([suite.Test("tests/host/test_x.py::test_it[a: b/c.py]", "passed", 1.25),
                  suite.Test("miniitx: tests/boot/test_x.py::test_it", "flaky", 2, failure="E  too late"),
                  suite.Test("desk: ddx: crash at random", "failed", 3.0, failure="first\nframe 7 torn\n"),
                  suite.Test("m32: ddx: crash at random", "skipped", 0.0, reason="no root"),
                  suite.Test("lint", "passed", 70.0)])
    found = read(path)
    assert [kind for kind, _ in found.values()] == ["passed", "passed", "failed", "skipped", "passed"]
    assert "too late" in found["miniitx: tests/boot/test_x.py::test_it"][1]
    assert found["desk: ddx: crash at random"][1] == "frame 7 torn"
    assert found["m32: ddx: crash at random"][1] == "no root"
    names = [one.attrib["name"] for one in xml.parse(path).getroot()]
    assert names == ["tests.host.test_x", "miniitx.tests.boot.test_x", "desk.ddx", "m32.ddx", "run"]


def test_the_file_is_written_when_the_run_stops(places: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A build fails after some tests."""
    def all_tests(run: Suite, words: list[str], board: str) -> None:
        run.take([suite.Test("desk: ddx: ring", "passed", 1.0)])
        raise Failed("exit status 1: meson")

    file = places / "it.xml"
    file.write_text("of the run before")
    monkeypatch.setattr(gate, "all_tests", all_tests)
    monkeypatch.setattr(sys, "argv", ["gate.py", "-junit", str(file), "words"])
    assert gate.main() == 1
    assert [kind for kind, _ in read(file).values()] == ["passed", "failed"]
    assert "exit status 1: meson" in file.read_text()


@pytest.mark.parametrize("name", ["", "it.xml/it.xml", "pipe"])
def test_a_results_file_that_cannot_be_written(name: str, places: pathlib.Path, monkeypatch: pytest.MonkeyPatch,
                                       capsys: pytest.CaptureFixture[str]) -> None:
    """Reported before the first test; a path that is not a file is not changed."""
    (places / "it.xml").touch()
    os.mkfifo(places / "pipe")
    monkeypatch.setattr(sys, "argv", ["gate.py", "-junit", str(places / name)])
    with pytest.raises(SystemExit) as status:
        gate.main()
    assert status.value.code == 2 and str(places / name) in capsys.readouterr().err
    assert (places / "pipe").is_fifo()
