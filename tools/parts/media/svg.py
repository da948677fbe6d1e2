# SPDX-License-Identifier: GPL-2.0-or-later
"""Diagrams as SVG, for a page or a file: bars on a logarithmic scale, and two linear axes."""
import dataclasses
import html
import math
from collections.abc import Sequence

WIDTH, LEFT, RIGHT, BAR, GAP = 900, 260, 100, 15, 16
GRID = '<path d="M{x:.1f} {top}V{bottom}" stroke="#ddd"/>'


@dataclasses.dataclass(frozen=True)
class Bar:
    group: str
    name: str
    colour: str
    value: float
    label: str
    mark: float = 0.0  # a second value, as a tick; 0: none


def text(x: float, y: float, words: str, anchor: str = "start", colour: str = "#000") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" fill="{colour}">{html.escape(words)}</text>'


def picture(content: str, width: float, height: float, more: str = "") -> str:
    return (f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}" width="{width:.0f}" '
            f'role="img"{more}>{content}</svg>')


def bars(rows: Sequence[Bar], low: int | None = None) -> tuple[str, float]:
    """A bar for each row, in groups, and the total height. The scale begins at 10^low, else at the smallest value."""
    values = [value for one in rows for value in (one.value, one.mark) if value > 0]
    first = math.floor(math.log10(min(values, default=1))) if low is None else low
    last = max(first + 1, math.ceil(math.log10(max(values, default=1))))

    def x(number: float) -> float:
        return LEFT + (WIDTH - LEFT - RIGHT) * (math.log10(max(number, 10.0**first)) - first) / (last - first)

    parts, y, group = [], 20.0, ""
    for one in rows:
        if one.group != group:
            group = one.group
            y += GAP
            parts.append(text(LEFT - 80, y + 11, group, "end"))
        parts += [text(LEFT - 6, y + 11, one.name, "end", one.colour),
                  f'<rect x="{LEFT}" y="{y}" width="{max(1.0, x(one.value) - LEFT):.1f}" height="{BAR - 3}" '
                  f'fill="{one.colour}"/>', text(x(one.value) + 5, y + 11, one.label)]
        if one.mark > 0:
            parts.append(f'<path d="M{x(one.mark):.1f} {y - 1}v{BAR - 1}" stroke="#222"/>')
        y += BAR
    grid = [GRID.format(x=x(10.0**power), top=16, bottom=y) + text(x(10.0**power), 12, f"{10.0**power:g}", "middle")
            for power in range(first, last + 1)]
    return "".join(grid + parts), y + 10


@dataclasses.dataclass(frozen=True)
class Axes:
    """From 0 to the largest value in both directions."""
    most_x: float
    most_y: float
    width: int = 760
    height: int = 220
    left: int = 60
    bottom: int = 30

    def point(self, x: float, y: float) -> tuple[float, float]:
        return (self.left + x / self.most_x * (self.width - self.left - 10),
                self.height - self.bottom - y / self.most_y * (self.height - self.bottom - 15))

    def line(self, points: Sequence[tuple[float, float]], colour: str) -> str:
        places = " ".join(f"{x:.1f},{y:.1f}" for x, y in (self.point(*one) for one in points))
        return f'<polyline points="{places}" fill="none" stroke="{colour}" stroke-width="2"/>'

    def column(self, at: float, value: float, colour: str, title: str) -> str:
        """From `at` to the next whole number."""
        (left, top), (right, floor) = self.point(at, value), self.point(at + 1, 0)
        return (f'<rect x="{left + 1:.1f}" y="{top:.1f}" width="{max(1.0, right - left - 2):.1f}" '
                f'height="{floor - top:.1f}" fill="{colour}"><title>{html.escape(title)}</title></rect>')

    def picture(self, marks: Sequence[tuple[float, str]], across: str, up: str, content: str) -> str:
        floor, right = self.height - self.bottom, self.width - 10
        grid = [GRID.format(x=self.point(x, 0)[0], top=15, bottom=floor)
                + text(self.point(x, 0)[0], floor + 13, name, "middle") for x, name in marks]
        frame = (f'<path d="M{self.left} 15V{floor}H{right}" fill="none" stroke="#888"/>'
                 + text(right, self.height - 2, across, "end") + text(self.left - 5, 20, f"{self.most_y:g}", "end")
                 + text(self.left - 5, floor, "0", "end") + text(4, self.height // 2, up))
        return picture("".join(grid) + frame + content, self.width, self.height)
