# SPDX-License-Identifier: GPL-2.0-or-later
"""The page of a benchmark, one file: bars for p50 on a logarithmic scale, with a tick at p99."""
import html
from typing import Any

from parts.media import svg

COLOURS = {"ddx": "#0b6e4f", "futex": "#9a9a9a", "iceoryx2": "#c8553d", "gstreamer": "#3d6fc8", "lcm": "#b08900"}


def panel(title: str, rows: list[dict[str, Any]], value: str, tick: str | None) -> str:
    """One bar a row, grouped by case; `tick` names a second value, shown as a mark."""
    content, height = svg.bars([svg.Bar(one["case"], one["peer"], COLOURS[one["peer"]], one[value], f"{one[value]:g}",
                                        one[tick] if tick else 0.0) for one in rows])
    return f"<h2>{html.escape(title)}</h2>{svg.picture(content, svg.WIDTH, height)}"


def page(result: dict[str, Any]) -> str:
    rows = result["cases"]
    about = result["machine"]
    return "\n".join([
        "<!DOCTYPE html><html lang=en><meta charset=utf-8><title>The store beside its peers</title>",
        "<style>body{font:14px sans-serif;margin:2em;max-width:60em}text{font:12px sans-serif}</style>",
        "<h1>The store beside its peers</h1>",
        f"<p>{html.escape(about['cpu'])}, {about['cores']} cores, Linux {html.escape(about['kernel'])}, load before "
        f"{about['load_before']}; {result['rounds']} rounds, interleaved. All peers sleep while waiting and touch "
        "every page. Read ratios, not absolute times. All scales are logarithmic.</p>",
        panel("Latency in µs: bar p50, mark p99", rows, "p50_us", "p99_us"),
        panel("Reader: CPU time per delivery in µs", rows, "reader_cpu_us", None),
        panel("Writer: CPU time per frame in µs", rows, "writer_cpu_us", None),
    ]) + "\n"
