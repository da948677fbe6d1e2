# SPDX-License-Identifier: GPL-2.0-or-later
"""The picture of a benchmark: one page, no other files. Bars for p50 on a logarithmic scale, a tick at p99."""
from __future__ import annotations

import html
import math
from typing import Any

COLOURS = {"ddx": "#0b6e4f", "futex": "#9a9a9a", "iceoryx2": "#c8553d", "gstreamer": "#3d6fc8", "lcm": "#b08900"}
WIDTH, LEFT, BAR, GAP = 900, 260, 15, 16


def panel(title: str, rows: list[dict[str, Any]], value: str, tick: str | None) -> str:
    """One bar a row, grouped by case; `tick` names a second value, shown as a mark."""
    values = [one[key] for one in rows for key in (value, tick) if key and one[key] > 0]
    low, high = math.floor(math.log10(min(values))), math.ceil(math.log10(max(values)))

    def x(number: float) -> float:
        span = max(1, high - low)
        return LEFT + (WIDTH - LEFT - 70) * (math.log10(max(number, 10**low)) - low) / span

    parts, y, case = [], 40.0, ""
    for one in rows:
        if one["case"] != case:
            case = one["case"]
            y += GAP
            parts.append(f'<text x="{LEFT - 80}" y="{y + 11}" text-anchor="end">{html.escape(case)}</text>')
        parts.append(f'<text x="{LEFT - 6}" y="{y + 11}" text-anchor="end" fill="{COLOURS[one["peer"]]}">'
                     f'{one["peer"]}</text>'
                     f'<rect x="{LEFT}" y="{y}" width="{max(1, x(one[value]) - LEFT):.1f}" height="{BAR - 3}" '
                     f'fill="{COLOURS[one["peer"]]}"/>')
        end = x(one[value])
        if tick:
            at = x(one[tick])
            parts.append(f'<line x1="{at:.1f}" x2="{at:.1f}" y1="{y - 1}" y2="{y + BAR - 2}" stroke="#222"/>')
        parts.append(f'<text x="{end + 5:.1f}" y="{y + 11}" class="number">{one[value]:g}</text>')
        y += BAR
    grid = "".join(f'<line x1="{x(10**power):.1f}" x2="{x(10**power):.1f}" y1="34" y2="{y}" stroke="#ddd"/>'
                   f'<text x="{x(10**power):.1f}" y="30" text-anchor="middle">{10**power:g}</text>'
                   for power in range(low, high + 1))
    return (f'<h2>{html.escape(title)}</h2><svg viewBox="0 0 {WIDTH} {y + 10:.0f}" width="{WIDTH}" role="img">'
            f'{grid}{"".join(parts)}</svg>')


def page(result: dict[str, Any]) -> str:
    rows = result["cases"]
    about = result["machine"]
    return "\n".join([
        "<!DOCTYPE html><html lang=en><meta charset=utf-8><title>The store beside its peers</title>",
        "<style>body{font:14px sans-serif;margin:2em;max-width:60em}text{font:12px sans-serif}",
        ".number{font-size:11px;fill:#444;paint-order:stroke;stroke:#fff;stroke-width:3px}</style>",
        "<h1>The store beside its peers</h1>",
        f"<p>{html.escape(about['cpu'])}, {about['cores']} cores, Linux {html.escape(about['kernel'])}, load before "
        f"{about['load_before']}; {result['rounds']} rounds, interleaved. Everybody sleeps while waiting and touches "
        "every page. Read ratios, not absolute times. All scales are logarithmic.</p>",
        panel("Latency in µs: bar p50, mark p99", rows, "p50_us", "p99_us"),
        panel("Reader: CPU time per delivery in µs", rows, "reader_cpu_us", None),
        panel("Writer: CPU time per frame in µs", rows, "writer_cpu_us", None),
    ]) + "\n"
