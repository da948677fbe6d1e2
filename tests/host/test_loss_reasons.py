# SPDX-License-Identifier: GPL-2.0-or-later
"""docs/architecture.md lists each reason for which a program can lose a frame, in the program's order."""
import re

import pytest

from parts.common import TOP

pytestmark = pytest.mark.retry

PAGE = TOP / "docs/architecture.md"
# The source with a list of reasons: the programs built from it.
PROGRAMS = {
    "package/ddxcatalog/catalog/catalog.c": "`ddxcatalog`",
    "package/ddxlog/log/logger.c": "`ddxlog`",
    "package/ddxlog/play/replay.c": "`ddxlog -replay`",
    "package/ddxvideo/grab/grabber.c": "`ddxvideoV4L`, `ddxvideo1394`",
    "package/ddxvideo/load/main.c": "`ddxvideoload`",
    "package/ddxvideo/play/player.c": "`ddxvideoplay`",
    "package/ddxvideo/save/recorder.c": "`ddxvideosave`",
    "package/ddxvideo/stereo/main.c": "`ddxvideoSVS`",
    "package/ddxvideo/stream/receive/viewer.h": "`ddxdecode`, `ddxvideoview -port`",
    "package/ddxvideo/stream/send/sender.c": "`ddxvideosend`",
}


def stated() -> dict[str, list[str]]:
    """The reasons in each source with such a list."""
    lists = {}
    for path in sorted([*TOP.glob("package/**/*.c"), *TOP.glob("package/**/*.h")]):
        found = re.search(r"(?:reasons\[\] =|_REASONS)[\s\\]*\{([^{}]*), NULL *\}", path.read_text())
        if found and "/include/" not in str(path):
            lists[str(path.relative_to(TOP))] = re.findall(r'"(\w+)"', found[1])
    return lists


def documented() -> dict[str, list[str]]:
    """The reasons in the page's table for each row of programs."""
    table = PAGE.read_text().partition("| program | reason | meaning |")[2].partition("\n\n")[0]
    rows: dict[str, list[str]] = {}
    name = ""
    for program, reason in re.findall(r"^\| (.*?) ?\| `(\w+)` \|", table, re.MULTILINE):
        name = program or name
        rows.setdefault(name, []).append(reason)
    return rows


def test_the_page_lists_each_reason_of_each_program() -> None:
    sources = stated()
    assert sorted(sources) == sorted(PROGRAMS)
    assert documented() == {PROGRAMS[path]: reasons for path, reasons in sources.items()}
