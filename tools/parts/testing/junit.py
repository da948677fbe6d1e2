# SPDX-License-Identifier: GPL-2.0-or-later
"""Write a run of the tests as a JUnit XML file for Jenkins, GitLab and others: a suite for each Python file of tests
and for each package of each C build, with the elements and attributes that the strictest readers allow."""
import argparse
import contextlib
import pathlib
import re
import time
import xml.etree.ElementTree as xml
from collections.abc import Iterator, Sequence

from parts.common import say
from parts.testing.suite import Suite, Test, first_words

ILLEGAL = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")  # in XML 1.0, also when escaped
MOST = 1_000_000  # characters of one failure: parsers and GitLab limit a file's size


def legal(text: str) -> str:
    return ILLEGAL.sub(lambda found: f"\\x{ord(found[0]):02x}", text)


def class_name(name: str) -> str:
    """`miniitx: tests/boot/test_x.py::test_it` is of miniitx.tests.boot.test_x, `desk: ddx: ring` of desk.ddx."""
    before, _, test = name.partition("::")
    if not test:
        before = name.rpartition(": ")[0]
    return re.sub(r"/|: ", ".", before.removesuffix(".py")) or "run"


def _case(suite: xml.Element, test: Test) -> None:
    case = xml.SubElement(suite, "testcase", classname=class_name(test.name), name=legal(test.name),
                          time=f"{test.seconds:.3f}")
    failure = legal(test.failure[-MOST:])
    if test.outcome == "failed":
        xml.SubElement(case, "failure", message=legal(first_words(test.failure))).text = failure
    elif test.outcome == "skipped":
        xml.SubElement(case, "skipped", message=legal(test.reason))
    elif test.outcome == "flaky":
        xml.SubElement(case, "system-out").text = f"FLAKY: failed at first, passed when it was run once more\n{failure}"


def _sums(tests: Sequence[Test]) -> dict[str, str]:
    failed = sum(test.outcome == "failed" for test in tests)
    return {"tests": str(len(tests)), "failures": str(failed), "errors": "0",
            "time": f"{sum(round(test.seconds, 3) for test in tests):.3f}"}


def document(tests: Sequence[Test]) -> xml.ElementTree:
    groups: dict[str, list[Test]] = {}
    for test in tests:
        groups.setdefault(class_name(test.name), []).append(test)
    root = xml.Element("testsuites", {**_sums(tests), "name": "make test"})
    written = time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime())
    for name, members in groups.items():
        skipped = sum(test.outcome == "skipped" for test in members)
        suite = xml.SubElement(root, "testsuite", {**_sums(members), "name": name, "skipped": str(skipped),
                                                   "timestamp": written})
        for test in members:
            _case(suite, test)
    xml.indent(root)
    return xml.ElementTree(root)


def target(name: str) -> pathlib.Path:
    """For argparse: check before the run that the file can be written, and remove that of an earlier run."""
    path = pathlib.Path(name)
    if path.exists() and not path.is_file():
        raise argparse.ArgumentTypeError(f"{path} exists, and is no file")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("")
        path.unlink()
    except OSError as error:
        raise argparse.ArgumentTypeError(f"{path} cannot be written: {error.strerror}") from None
    return path


@contextlib.contextmanager
def written(path: pathlib.Path | None, run: Suite) -> Iterator[None]:
    """Write the file at the end of a run; an error or Ctrl-C that stops the run is a failure in the file."""
    try:
        yield
    except BaseException as error:
        run.fail("the run", f"stopped before its end: {error or type(error).__name__}")
        raise
    finally:
        if path:
            new = path.with_name(f".{path.name}.new")
            document(run.tests).write(new, encoding="utf-8", xml_declaration=True)
            new.replace(path)
            say(f"JUnit XML: {path}")
