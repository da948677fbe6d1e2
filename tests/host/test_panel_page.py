# SPDX-License-Identifier: GPL-2.0-or-later
"""The panel's page as the image has it: small, and the same files as in the tree."""
import gzip
import pathlib
import re

import pytest

from parts.common import TOP

pytestmark = pytest.mark.strict

PAGE = TOP / "package/ddxpanel/page"
BYTES, REQUESTS = 60 << 10, 8  # at the first visit; a slow link carries that in 3 s
ASKED = 1  # GET panel/session


def fetched(first: str) -> set[str]:
    """The files that a browser fetches for the page `first` before it shows anything."""
    found, left = set(), {first}
    while left:
        name = left.pop()
        found.add(name)
        text = (PAGE / name).read_text()
        named = re.findall(r'(?:href|src)="([\w.]+)"', text) if name.endswith(".html") else \
            re.findall(r'^(?:import|export)\b[^;(]*"\./([\w.]+)";', text, re.M)
        left |= set(named) - found
    return found


def test_the_page_is_small_and_compressed(root: pathlib.Path) -> None:
    folder = root / "usr/share/ddx/panel"
    image = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert {name: gzip.decompress(data) for name, data in image.items()} == {
        path.name: path.read_bytes() for path in PAGE.iterdir()}
    first = fetched("index.html")
    assert {"index.html", "panel.js", "dom.js", "style.css"} <= first <= image.keys()
    assert len(first) + ASKED <= REQUESTS
    assert sum(map(len, image.values())) <= BYTES
