# SPDX-License-Identifier: GPL-2.0-or-later
"""Charts: positions of bars and columns, and well-formed XML."""
import re
import xml.etree.ElementTree as xml
from typing import Any

import pytest

from parts.bench import record_plot
from parts.media import svg
from parts.media.svg import Axes, Bar


def lengths(content: str) -> list[float]:
    return [float(found) for found in re.findall(r'<rect [^>]*width="([\d.]+)"', content)]


@pytest.mark.parametrize("low, expected", [(0, [1 / 3, 2 / 3, 1]), (None, [0, 1 / 2, 1])])
def test_bars_are_logarithmic(low: int | None, expected: list[float]) -> None:
    content, height = svg.bars([Bar("a", "<x>", "#111", 10, "ten", 1000), Bar("a", "y", "#111", 100, ""),
                                Bar("b", "z", "#111", 1000, "")], low)
    whole = svg.WIDTH - svg.LEFT - svg.RIGHT
    assert lengths(content) == pytest.approx([max(1, whole * part) for part in expected], abs=0.1)
    assert xml.fromstring(svg.picture(content, svg.WIDTH, height)).findtext(".//*[.='<x>']") == "<x>"
    assert svg.bars([])[0] and lengths(svg.bars([Bar("a", "x", "#111", 0, "")])[0]) == [1]


def test_columns_start_at_the_axis() -> None:
    axes = Axes(10, 4)
    content = axes.column(2, 4, "#111", "4") + axes.line([(0, 0), (10, 4)], "#222")
    root = xml.fromstring(axes.picture([(0, "0")], "s", "n", content))
    rect = root.find("{*}rect")
    assert rect is not None and float(rect.attrib["y"]) == 15
    assert float(rect.attrib["y"]) + float(rect.attrib["height"]) == axes.height - axes.bottom


def test_a_comparison_of_file_systems() -> None:
    def case(system: str, writer: str, hertz: float, lost: int) -> dict[str, Any]:
        return {"case": f"{system} {writer}", "file_system": system, "writer": writer, "neighbour_hertz": hertz,
                "stall_ms": 40.0, "lost": lost}

    page = record_plot.picture([case("ext3", "naive", 20, 3), case("ext3", "ours", 20, 0), case("ext4", "ours", 0.2, 0),
                                {"case": "slow"}])
    assert xml.fromstring(page) is not None and page.count("<g ") == 2 and page.count("<rect") == 4
    assert "40 ms, 3 lost" in page and "every 5 s" in page and "20 times a second" in page
