# SPDX-License-Identifier: GPL-2.0-or-later
"""The picture and the table of bench/record.py: longest stall and frames lost, naive and ours side by side."""
from typing import Any

from parts.common import say
from parts.media import svg

COLOURS = {"naive": "#c8553d", "ours": "#0b6e4f"}
NAMES = {"ext3": "ext3, journal", "ext4-journal": "ext4, journal", "ext4": "ext4, no journal"}
STYLE = ' font-family="sans-serif" font-size="12"'


def picture(cases: list[dict[str, Any]]) -> str:
    """The comparison of file systems, as far as measured: a bar for the longest write, and the lost frames."""
    rows = [one for one in cases if one["case"].startswith("ext")]
    panels, top = ['<rect width="100%" height="100%" fill="#fff"/>'], 0.0
    for hertz in sorted({one["neighbour_hertz"] for one in rows}, reverse=True):
        often = f"{hertz:g} times a second" if hertz >= 1 else f"every {1 / hertz:g} s"
        content, height = svg.bars([
            svg.Bar(NAMES[one["file_system"]], one["writer"], COLOURS[one["writer"]], one["stall_ms"],
                    f"{one['stall_ms']:.0f} ms, {one['lost'] or 'none'} lost")
            for one in rows if one["neighbour_hertz"] == hertz], 0)
        title = f"Longest write in ms, and frames lost; a neighbour calls fsync {often}"
        panels.append(f'{svg.text(4, top + 14, title)}<g transform="translate(0 {top + 22:.0f})">{content}</g>')
        top += height + 32
    return svg.picture("\n".join(panels), svg.WIDTH, top, STYLE) + "\n"


def table(cases: list[dict[str, Any]]) -> None:
    say("| case | s | published | recorded | lost | longest gap | longest write ms | fsyncs | host's load |")
    say("|---|---|---|---|---|---|---|---|---|")
    for one in cases:
        stall = "-" if one["stall_ms"] is None else round(one["stall_ms"])
        say(f"| {one['case']} | {one['seconds']} | {one['published']} | {one['recorded']} | {one['lost']} | "
            f"{one['longest_gap']} | {stall} | {one['fsyncs']} | {one['host_load']} |")
