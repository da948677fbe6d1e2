# SPDX-License-Identifier: GPL-2.0-or-later
"""The report of `make run`: as JSON, and as a self-contained page for a browser."""
import dataclasses
import html
import json
import math

from parts.media import svg
from parts.media.counters import Counters

# Buckets of the statistics, see ddx_stats.h: below 32 µs one for each, above 32 for each power of two.
FINE = 32
COLOURS = {"stored": "#0b6e4f", "recorded": "#3d6fc8", "sent": "#c8553d", "decoded": "#b08900"}


@dataclasses.dataclass
class Stage:
    """A stage on a frame's way: frames out, lost frames, and latency."""
    name: str
    frames: int
    lost: int
    counters: Counters
    histogram: list[int] = dataclasses.field(default_factory=list)


@dataclasses.dataclass
class About:
    """The run's parameters: keys of report.json, which docs/ci.md lists."""
    version: str
    source: str
    image: str
    accel: str
    boot: dict[str, object] = dataclasses.field(default_factory=dict)
    stream: dict[str, object] = dataclasses.field(default_factory=dict)  # how pictures were compared


@dataclasses.dataclass
class Report:
    """A run; `seconds` are the stages' counters in each second."""
    frames_in: int
    stages: list[Stage]
    about: About
    disagreements: list[str]
    seconds: list[tuple[float, dict[str, int]]]
    passed: bool
    notes: list[str] = dataclasses.field(default_factory=list)  # how the frames were compared, and the limits of that

    def json(self) -> str:
        return json.dumps({
            "passed": self.passed,
            "frames": {"in": self.frames_in, **{one.name: one.frames for one in self.stages}},
            "lost": {LOST[one.name]: one.lost for one in self.stages},
            "latency_us": {LOST[one.name]: one.counters.latency for one in self.stages if one.counters.latency},
            **dataclasses.asdict(self.about),
            "notes": self.notes, "disagreements": self.disagreements}, indent=2) + "\n"


# A stage is named after the result; its losses and latencies in report.json after the action.
SINCE = {"stored": "since the capture", "recorded": "since it is in the store", "sent": "since it is in the store",
         "decoded": "since the capture"}
WHERE = {"stored": "in the store, for all programs", "recorded": "in the recording, by ddxvideosave",
         "sent": "into the network, by ddxvideosend", "decoded": "received and decoded, by ddxdecode"}
READING = """Latency: half of the frames took at most p50, 99 % of them at most p99. A frame lost for the reason
<i>store</i> was overwritten in the store before this stage had read it. The stream may lose frames, since
nothing waits for it; the recording may not."""
LOST = {"stored": "store", "recorded": "record", "sent": "send", "decoded": "stream"}


def bucket_us(index: int) -> float:
    """The middle of a bucket."""
    if index < FINE:
        return float(index)
    shift = index // FINE - 1
    return ((FINE + index % FINE) + 0.5) * float(1 << shift)


def over_time(report: Report) -> str:
    """Frames out of each stage a second, by its counters."""
    pairs = [(before, after) for before, after in zip(report.seconds, report.seconds[1:]) if after[0] > before[0]]
    rates = {name: [(after[0], (after[1][name] - before[1][name]) / (after[0] - before[0])) for before, after in pairs]
             for name in COLOURS}
    if not pairs:
        return ""
    most_x = max(1.0, report.seconds[-1][0])
    most_y = math.ceil(max(1.0, *(rate for points in rates.values() for _, rate in points)))
    step = max(1, round(most_x / 10))
    axes = svg.Axes(most_x, most_y)
    lines = "".join(axes.line(rates[name], colour) + svg.text(70 + 90 * index, 11, name, colour=colour)
                    for index, (name, colour) in enumerate(COLOURS.items()))
    marks = [(float(second), str(second)) for second in range(0, int(most_x) + 1, step)]
    return axes.picture(marks, "seconds", "per s", lines)


def halves(stage: Stage) -> dict[int, int]:
    """The histogram in halves of powers of two: frames by 2 log2 of their µs."""
    counts: dict[int, int] = {}
    for index, count in enumerate(stage.histogram):
        if count:
            half = max(0, int(2 * math.log2(max(bucket_us(index), 1))))
            counts[half] = counts.get(half, 0) + count
    return counts


def histogram(stage: Stage, last: int) -> str:
    """Frames by latency, on the same logarithmic scale for all stages."""
    counts = halves(stage)
    most = max(counts.values())
    axes = svg.Axes(last, most)
    columns = "".join(axes.column(half, count, COLOURS[stage.name], str(count)) for half, count in counts.items())
    marks = [(float(half), _time(2 ** (half / 2))) for half in range(0, last + 1, 4)]
    return axes.picture(marks, SINCE[stage.name], "frames", columns)


def _time(microseconds: float) -> str:
    if microseconds < 1000:
        return f"{microseconds:.0f} µs"
    return f"{microseconds / 1000:.0f} ms" if microseconds < 1e6 else f"{microseconds / 1e6:.0f} s"


def _row(one: Stage) -> str:
    latency = "".join(f"<td>{one.counters.latency.get(key, 0)}</td>" for key in ("p50", "p99", "max"))
    lost = ", ".join(f"{reason} {count}" for reason, count in one.counters.lost.items() if count)
    return (f'<tr><th style="color:{COLOURS[one.name]}">{one.name}</th><td>{one.frames}</td><td>{one.lost}</td>'
            f"<td class=text>{html.escape(lost)}</td>{latency}<td class=text>{SINCE[one.name]}</td>"
            f"<td class=text>{WHERE[one.name]}</td></tr>")


def page(report: Report) -> str:
    last = 1 + max((half for one in report.stages for half in halves(one)), default=1)
    wrong = "".join(f"<p class=wrong>{html.escape(text)}</p>" for text in report.disagreements)
    notes = "".join(f"<p>{html.escape(text)}</p>" for text in report.notes)
    about = ", ".join(f"{name} {html.escape(str(value))}" for name, value in dataclasses.asdict(report.about).items()
                      if not isinstance(value, dict))
    return "\n".join([
        "<!DOCTYPE html><html lang=en><meta charset=utf-8><title>A run of the appliance</title>",
        "<style>body{font:14px sans-serif;margin:2em;max-width:72em}text{font:12px sans-serif}td{text-align:right;"
        "padding:0 .7em}.wrong{color:#b00}.text{text-align:left}svg{display:block}</style>",
        f"<h1>A run of the appliance: {report.frames_in} frames</h1>",
        "<p><b>Passed.</b></p>" if report.passed else "<p class=wrong><b>Failed.</b></p>", wrong, notes,
        "<table><tr><th><td>frames<td>lost<td class=text>reasons<td>p50 µs<td>p99 µs<td>max µs<td class=text>latency"
        "<td class=text>where these frames are</tr>",
        f"<tr><th>in</th><td>{report.frames_in}</td><td><td><td><td><td><td><td class=text>in the clip</td></tr>",
        *(_row(one) for one in report.stages), f"</table><p>{READING}</p><p>{about}</p>",
        "<h2>Frames a second</h2>", over_time(report),
        *(f"<h2>Latency: {one.name}</h2>{histogram(one, last)}" for one in report.stages if any(one.histogram)),
    ]) + "\n"
