# SPDX-License-Identifier: GPL-2.0-or-later
"""The page of the benchmark over a lossy link, one file: a table, and pictures of the operator's screen."""
import base64
import html
import subprocess
from typing import Any, NamedTuple

from bench.clips import SIZE
from bench.loss_figures import Picture, mean, psnr
from bench.loss_peers import Peer
from bench.loss_run import CLEAN, COLUMNS
from parts.common import MORTAL, say

Rows = list[dict[str, Any]]
STYLE = ("body{font:14px sans-serif;margin:2em}table{border-collapse:collapse}td,th{padding:2px 10px;text-align:right}"
         "img{width:264px;display:block}.pictures td,.pictures th{padding:2px 4px;text-align:center}"
         "tr>th:first-child{text-align:left}.pictures th:first-child{max-width:10em}")
SOURCE = ("the source", CLEAN)  # the key of the source picture among the screens


class Screen(NamedTuple):
    """The picture on an operator's screen as JPEG, and a caption."""
    data: bytes
    caption: str


Screens = dict[tuple[str, str], Screen]  # by line and column of the table


def screen(shown: Picture, source: Picture) -> Screen:
    return Screen(jpeg(shown), f"{psnr(shown, source):.1f} dB")


def jpeg(picture: Picture) -> bytes:
    words = ["ffmpeg", "-v", "error", "-f", "rawvideo", "-pix_fmt", "yuv420p", "-s", SIZE, "-i", "pipe:0", "-q:v", "5",
             "-pix_fmt", "yuvj420p", "-f", "mjpeg", "pipe:1"]
    return subprocess.run([*MORTAL, *words], input=picture.tobytes(), stdout=subprocess.PIPE, check=True).stdout


def title(row: dict[str, Any]) -> str:
    """The title of a case's line in the table, for all columns and seeds."""
    parts = [str(row["peer"]), "reports" if row["reports"] else "one-way", f"RTT {row['rtt_ms']:g} ms"]
    parts += [row["options"]] if row["options"] else []
    parts += [f"within {row['deadline_ms']} ms"] if row["deadline_ms"] > Peer.deadline_ms else []
    parts += [f"{row['operators']} operators"] if row["operators"] > 1 else []
    return ", ".join([*parts, "joins at"] if row["join"] else parts)


def lines(rows: Rows) -> dict[str, Rows]:
    found: dict[str, Rows] = {}
    for row in rows:
        found.setdefault(title(row), []).append(row)
    return found


def average(rows: Rows, what: str) -> float:
    return mean([row[what] for row in rows if row.get(what) is not None])


def number(value: float, digits: int = 1) -> str:
    return "-" if value != value else f"{value:.{digits}f}"


def cell(rows: Rows, column: str) -> str:
    """Usable %, whole % at any time, dB on the screen; of a join the seconds."""
    some = [row for row in rows if row["column"] == column]
    if not some:
        return "-"
    if some[0]["join"]:
        return "never" if any(row["join_s"] is None for row in some) else f"{max(row['join_s'] for row in some):.2f} s"
    return " / ".join(number(average(some, what)) for what in ("usable", "whole", "screen_db"))


def summary(rows: Rows) -> list[list[str]]:
    """The table, with its head, without columns that were not run."""
    columns = [column for column in COLUMNS if any(row["column"] == column for row in rows)]
    table = [["usable % / whole whenever % / dB on screen", *columns, "clean dB", "wire kbit/s", "peak", "back",
              "clean p50, p99 ms", "iid 30 p99"]]
    for name, mine in lines(rows).items():
        clean = [row for row in mine if row["column"] == CLEAN]
        table.append([name, *(cell(mine, column) for column in columns), number(average(clean, "screen_db")),
                      number(average(mine, "wire_kbit"), 0),
                      number(max(row["wire_peak_kbit"] for row in mine), 0), number(average(mine, "back_kbit"), 0),
                      f"{number(average(clean, 'p50_ms'))}, {number(average(clean, 'p99_ms'))}",
                      number(average([row for row in mine if row["column"] == "iid 30"], "p99_ms"))])
    return table


def print_table(rows: Rows) -> None:
    table = summary(rows)
    widths = [max(len(line[at]) for line in table) for at in range(len(table[0]))]
    for line in table:
        say("  ".join(text.rjust(width) if at else text.ljust(width)
                      for at, (text, width) in enumerate(zip(line, widths))))


def _row(cells: list[str], head: bool) -> str:
    first, *others = [html.escape(text) for text in cells]
    kind = "th" if head else "td"
    return f"<tr><th>{first}</th>" + "".join(f"<{kind}>{text}</{kind}>" for text in others) + "</tr>"


def _cell(screens: Screens, name: str, column: str) -> str:
    if not (found := screens.get((name, column))):
        return "<td></td>"
    data = base64.b64encode(found.data).decode()
    return f'<td><img src="data:image/jpeg;base64,{data}" alt="{column}">{html.escape(found.caption)}</td>'


def _pictures(screens: Screens) -> str:
    """A line for each peer."""
    columns = [column for column in (CLEAN, *COLUMNS) if any(column == one for _, one in screens)]
    text = "<tr><th></th>" + "".join(f"<th>{column}</th>" for column in columns) + "</tr>"
    for name in dict.fromkeys(name for name, _ in screens):
        cells = "".join(_cell(screens, name, column) for column in columns)
        text += f"<tr><th>{html.escape(name)}</th>{cells}</tr>"
    return text


def page(rows: Rows, screens: Screens, about: str) -> str:
    table = summary(rows)
    return "\n".join([
        "<!DOCTYPE html><html lang=en><meta charset=utf-8><title>The stream over a lossy link</title>",
        f"<style>{STYLE}</style><h1>The stream over a lossy link</h1>", f"<p>{html.escape(about)}</p><table>",
        *(_row(line, not at) for at, line in enumerate(table)), "</table>",
        "<h2>On the operator's screen</h2><p>When the same frame of the clip had to be there: the newest picture until "
        "then, compared with that frame of the source.</p>",
        f"<table class=pictures>{_pictures(screens)}</table>"]) + "\n"
