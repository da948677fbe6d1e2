#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""results.py: writes docs/results.md from what the long tests have left in output/long: what was asked, what was
measured, on which commit, and the command that does it again."""
import ast
import json
import pathlib
import re
from typing import Any

from common import OUTPUT, TOP, Failed, finish, say

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


def table(path: pathlib.Path, results: list[dict[str, Any]]) -> str:
    lines = [f"## {path.stem}", "", about(path), "", f"    make test-long T={path.stem}", "",
             "| asked | measured | outcome | s | commit |", "|---|---|---|---|---|"]
    for one in results:
        name, _, variant = one["test"].split("::")[1].partition("[")
        variant = re.sub(r"^(bios|uefi)-?", "", variant.rstrip("]"))
        what = name.removeprefix("test_").replace("_", " ") + (f" ({variant})" if variant else "")
        lines.append(f"| {what} | {figures(one['figures'])} | {one['outcome']} | {one['seconds']:.0f} "
                     f"| {one['commit']} |")
    return "\n".join(lines) + "\n"


def main() -> int:
    results = [json.loads(path.read_text()) for path in sorted(LONG.glob("*.json"))]
    if not results:
        raise Failed(f"nothing in {LONG}: make test-long comes first")
    files: dict[pathlib.Path, list[dict[str, Any]]] = {}
    for one in results:
        path = TOP / str(one["test"]).split("::", maxsplit=1)[0]
        if path.exists():
            files.setdefault(path, []).append(one)
    PAGE.write_text("\n".join([HEAD, *(table(path, some) for path, some in sorted(files.items()))]))
    failed = sum(one["outcome"] != "passed" for one in results)
    say(f"results: {len(results)} tests, {failed} failed: {PAGE.relative_to(TOP)}")
    return 0


if __name__ == "__main__":
    finish("results", main)
