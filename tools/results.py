#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""results.py: brings docs/results.md up to date with what the long tests have left in output/long: what was asked, what
was measured, on which commit, and the command that does it again. What another machine has measured stays until it
is measured anew; so do sections about something else, which are written by hand."""
import ast
import json
import pathlib
import re
from typing import Any

from parts.common import OUTPUT, TOP, Failed, finish, say

LONG = OUTPUT / "long"
PAGE = TOP / "docs/results.md"
HEAD = """\
# What the long tests have measured

Written by `tools/results.py` from `output/long/<test>.json`, which `make test-long` leaves. Guests are emulated (TCG)
on two processors that others use as well: losses, order and bytes are judged, times are figures. Figures of `make
bench` are in [bench.md](bench.md), of `make bench-record` and `make powercut` in [recording.md](recording.md).
"""


def about(path: pathlib.Path) -> str:
    """What a file of tests is about."""
    return " ".join((ast.get_docstring(ast.parse(path.read_text())) or "").split())


def show(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name} {show(one)}" for name, one in value.items() if one not in (0, {}))
    if isinstance(value, list):
        return " ".join(show(one) for one in value)
    return str(value)


def figures(found: dict[str, Any]) -> str:
    return "; ".join(f"{name.replace('_', ' ')}: {show(value)}" for name, value in found.items()) or "-"


def row(one: dict[str, Any]) -> str:
    name, _, variant = one["test"].split("::")[1].partition("[")
    variant = re.sub(r"^(bios|uefi)-?", "", variant.rstrip("]"))
    what = name.removeprefix("test_").replace("_", " ") + (f" ({variant})" if variant else "")
    return f"| {what} | {figures(one['figures'])} | {one['outcome']} | {one['seconds']:.0f} | {one['commit']} |"


def asked(line: str) -> str:
    return line.split(" | ", maxsplit=1)[0]


def section(path: pathlib.Path, rows: list[str]) -> str:
    return "\n".join([f"## {path.stem}", "", about(path), "", f"    make test-long T={path.stem}", "",
                      "| asked | measured | outcome | s | commit |", "|---|---|---|---|---|",
                      *sorted(rows, key=asked)]) + "\n"


def page(former: str, results: list[dict[str, Any]]) -> str:
    """The page anew: its former text, with these results in it."""
    own: list[str] = []
    rows: dict[str, dict[str, str]] = {}
    for text in former.split("\n## ")[1:]:
        name, _, rest = text.partition("\n")
        if "| asked |" in rest:
            lines = [line for line in rest.splitlines() if line.startswith("| ") and not line.startswith("| asked |")]
            rows[name] = {asked(line): line for line in lines}
        else:
            own.append(f"## {name}\n{rest.rstrip()}\n")
    for one in results:
        line = row(one)
        rows.setdefault(pathlib.Path(one["test"].split("::")[0]).stem, {})[asked(line)] = line
    files = {path.stem: path for path in sorted(TOP.glob("tests/*/test_*.py"), reverse=True)}  # boot tests first
    return "\n".join([HEAD, *own, *(section(files[name], list(rows[name].values())) for name in sorted(rows)
                                    if name in files)])


def main() -> int:
    results = [json.loads(path.read_text()) for path in sorted(LONG.glob("*.json"))]
    if not results:
        raise Failed(f"nothing in {LONG}: make test-long comes first")
    PAGE.write_text(page(PAGE.read_text() if PAGE.exists() else "", results))
    failed = sum(one["outcome"] != "passed" for one in results)
    say(f"results: {len(results)} tests, {failed} failed: {PAGE.relative_to(TOP)}")
    return 0


if __name__ == "__main__":
    finish("results", main)
