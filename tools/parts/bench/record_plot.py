# SPDX-License-Identifier: GPL-2.0-or-later
"""The picture and the table of tools/bench_record.py: longest stall and frames lost, naive and ours side by side."""
from __future__ import annotations

import html
import math
from typing import Any

from parts.common import say

COLOURS = {"naive": "#c8553d", "ours": "#0b6e4f"}
WIDTH, LEFT, RIGHT, BAR, GAP = 760, 165, 100, 17, 12
NAMES = {"ext3": "ext3, journal", "ext4-journal": "ext4, journal", "ext4": "ext4, no journal"}


def _panel(title: str, rows: list[dict[str, Any]], top: float) -> tuple[str, float]:
    """A bar for the longest write, on a logarithmic scale from 1 ms, and what was lost behind it."""
    most = max(10.0, *(one["stall_ms"] for one in rows))
    decades = math.ceil(math.log10(most))

    def x(number: float) -> float:
        return LEFT + (WIDTH - LEFT - RIGHT) * (math.log10(number) / decades if number > 1 else 0)

    y, last, bars = top + 40, "", ""
    for one in rows:
        if one["file_system"] != last:
            last = one["file_system"]
            y += GAP
            bars += f'<text x="{LEFT - 55}" y="{y + 22}" text-anchor="end">{html.escape(NAMES[last])}</text>'
        colour = COLOURS[one["writer"]]
        bars += (f'<text x="{LEFT - 6}" y="{y + 12}" text-anchor="end" fill="{colour}">{one["writer"]}</text>'
                 f'<rect x="{LEFT}" y="{y}" width="{max(1.0, x(one["stall_ms"]) - LEFT):.1f}" height="{BAR - 3}" '
                 f'fill="{colour}"/><text x="{x(one["stall_ms"]) + 5:.1f}" y="{y + 12}">{one["stall_ms"]:.0f} ms, '
                 f'{one["lost"] or "none"} lost</text>')
        y += BAR
    grid = "".join(f'<line x1="{x(10**power):.1f}" x2="{x(10**power):.1f}" y1="{top + 36}" y2="{y}" stroke="#ddd"/>'
                   f'<text x="{x(10**power):.1f}" y="{top + 32}" text-anchor="middle">{10**power}</text>'
                   for power in range(decades + 1))
    return f'<text x="4" y="{top + 14}" font-weight="bold">{html.escape(title)}</text>{grid}{bars}', y + 20


def picture(cases: list[dict[str, Any]]) -> str:
    """Of the comparison of file systems; whatever of it there is."""
    rows = [one for one in cases if one["case"].startswith("ext")]
    panels, end = [], 0.0
    for hertz in sorted({one["neighbour_hertz"] for one in rows}, reverse=True):
        some = [one for one in rows if one["neighbour_hertz"] == hertz]
        often = f"{hertz:g} times a second" if hertz >= 1 else f"every {1 / hertz:g} s"
        panel, end = _panel(f"Longest write in ms, and frames lost; a neighbour calls fsync {often}", some, end)
        panels.append(panel)
    return (f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {end:.0f}" width="{WIDTH}" '
            f'font-family="sans-serif" font-size="12"><rect width="100%" height="100%" fill="#fff"/>\n'
            + "\n".join(panels) + "\n</svg>\n")


def table(cases: list[dict[str, Any]]) -> None:
    say("| case | s | published | recorded | lost | longest gap | longest write ms | fsyncs | host's load |")
    say("|---|---|---|---|---|---|---|---|---|")
    for one in cases:
        stall = "-" if one["stall_ms"] is None else round(one["stall_ms"])
        say(f"| {one['case']} | {one['seconds']} | {one['published']} | {one['recorded']} | {one['lost']} | "
            f"{one['longest_gap']} | {stall} | {one['fsyncs']} | {one['host_load']} |")
