#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""make results: write output/results.md from the results of long runs below output/: commit, options and, for each long
test, its question, its figures and the command that repeats it."""
import ast
import pathlib
from typing import Any

from parts.common import OUTPUT, TOP, Failed, finish, say
from parts.testing import campaign

LONG = OUTPUT / "long"
PAGE = OUTPUT / "results.md"
Result = dict[str, Any]


def about(path: pathlib.Path) -> str:
    """The docstring of a file of tests, in one line."""
    return " ".join((ast.get_docstring(ast.parse(path.read_text())) or "").split())


def show(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name} {show(one)}" for name, one in value.items() if one not in (0, {}))
    if isinstance(value, list):
        return " ".join(show(one) for one in value)
    return str(value)


def figures(found: Result) -> str:
    return "; ".join(f"{name.replace('_', ' ')}: {show(value)}" for name, value in found.items()) or "-"


def row(one: Result) -> str:
    name, _, variant = one["test"].split("::")[1].partition("[")
    variant = variant.rstrip("]")
    what = name.removeprefix("test_").replace("_", " ") + (f" ({variant})" if variant else "")
    return f"| {what} | {figures(one['figures'])} | {one['outcome']} | {one['seconds']:.0f} |"


def section(board: str, commit: str, file: str, results: list[Result]) -> str:
    stem = pathlib.Path(file).stem
    return "\n".join([f"## {stem} ({board}, {commit})", "", about(TOP / file), "",
                      f"    make test-long BOARD={board} T={stem}", "", "| asked | measured | outcome | s |",
                      "|---|---|---|---|", *sorted(row(one) for one in results)]) + "\n"


def board_page(file: pathlib.Path) -> list[str]:
    """The long tests of one image."""
    key, results = campaign.read(file)
    files: dict[str, list[Result]] = {}
    for one in results.values():
        files.setdefault(one["test"].split("::")[0], []).append(one)
    return [section(file.stem, key["commit"], name, files[name]) for name in sorted(files) if (TOP / name).exists()]


def overview(files: list[pathlib.Path]) -> str:
    read = [(file, *campaign.read(file)) for file in files]
    return "\n".join(["# Results of long runs", "", "| file | commit | options | steps |", "|---|---|---|---|",
                      *(f"| {file.relative_to(OUTPUT)} | {key['commit']} | {show(key['options']) or '-'} | "
                        f"{len(results)} |" for file, key, results in read if key)]) + "\n"


def main() -> int:
    files = sorted(OUTPUT.glob("*/*.jsonl"))
    if not any(campaign.read(file)[1] for file in files):
        raise Failed(f"no results in {OUTPUT}: run make test-long first")
    PAGE.write_text("\n".join([overview(files), *(text for file in files if file.parent == LONG
                                                  for text in board_page(file))]))
    say(f"results: {PAGE.relative_to(TOP)}")
    return 0


if __name__ == "__main__":
    finish("results", main)
