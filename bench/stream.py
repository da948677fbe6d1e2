# SPDX-License-Identifier: GPL-2.0-or-later
"""make bench: latency of the stream, from a ready frame to its decoded pixels, and the sender's CPU time.

tools/bench stream [-rounds N] [-short]: in its own network namespace. Prints a table and writes
output/bench/stream.json. A round plays 15 s of the real clip at CIF 25 with each codec, then runs the sender's encoder
alone (bench/encode.c) for as long; then two senders, one with repair, reports and SRTP and one without, and the
encoder, all at the same time, over a link that loses 30 % of the packets. The figures come from the numbers in the
pictures, the store's times and the kernel's CPU accounting, not from the programs. -short: a second of a generated
clip, for the gate; writes no file.
"""
import dataclasses
import os
import pathlib
import statistics
import subprocess
import time
from typing import Any

from bench.clips import RATE, numbered
from bench.measure import cpus, percentile, save
from bench.programs import Programs
from bench.stream_cost import percents, protection
from parts.common import MORTAL, OUTPUT, Failed, command_line, finish, say, scratch, wait_until
from parts.image import native
from parts.media import clip as made_up
from parts.processes import kill
SECONDS, WARM_UP = 15, 2
BITRATE = 200
LIMIT_P50_MS, LIMIT_SENDER_PERCENT = 2.0, 4.0
# Names of bench/encode.c, and the sender's options.
CODECS = {"h264": ["-codec", "h264"], "ultrafast": ["-codec", "h264", "-preset", "ultrafast"],
          "mpeg4": ["-codec", "mpeg4"]}
ENCODE = OUTPUT / "desk/ddxvideo/tests/encode"


@dataclasses.dataclass(frozen=True)
class Plan:
    """The clip of a slice, and how long it is measured (s)."""
    clip: pathlib.Path
    warm_up: float
    seconds: float
    least: int  # frames that must arrive


def whole() -> Plan:
    return Plan(numbered("real", SECONDS), WARM_UP, SECONDS - WARM_UP - 2, SECONDS * RATE // 2)


def short(folder: pathlib.Path) -> Plan:
    """One second, for the gate."""
    return Plan(made_up.write(folder / "short.y4m", 1), 0.1, 0.5, 1)


def slice_of(codec: str, folder: pathlib.Path, plan: Plan) -> dict[str, Any]:
    with Programs(folder) as programs:
        decode = programs.start("ddxdecode", "-headless", "-name", "seen")
        sender = programs.start("ddxvideosend", *CODECS[codec], "-bitrate", str(BITRATE))
        watchers = [programs.watch(item) for item in ("video", "seen")]
        loader = programs.start("ddxvideoload", str(plan.clip), "-readers", "2")
        wait_until(lambda: programs.count("ddxvideoload", "out") > 0, "the clip is not played")
        time.sleep(plan.warm_up)
        cost = percents({"sender_percent": sender, "decode_percent": decode}, plan.seconds)
        loader.wait(30)
        time.sleep(0.5)  # the last frames are on their way
        video, seen = [watcher.stop() for watcher in watchers]
    ready = {number: written for number, written in video if number is not None}
    latency = [(written - ready[number]) / 1e6 for number, written in seen if number in ready]
    if len(latency) < plan.least:
        raise Failed(f"{codec}: only {len(latency)} frames arrived")
    return {"codec": codec, "latency_ms": latency, **cost}


def alone(codec: str, plan: Plan) -> float:
    """CPU time of the encoder without a sender, in percent of a core."""
    encoder = subprocess.Popen([*MORTAL, ENCODE, plan.clip, codec, str(BITRATE)])
    try:
        time.sleep(plan.warm_up)
        return percents({ENCODE.name: encoder}, plan.seconds)[ENCODE.name]
    finally:
        kill(encoder)


def report_protection(rounds: list[dict[str, float]]) -> dict[str, float]:
    """Medians, and what protection adds, in percent of a core and relative to the encoder."""
    added = [one["protected"] - one["plain"] for one in rounds]
    return {**{f"{name}_percent": round(statistics.median(one[name] for one in rounds), 2) for name in rounds[0]},
            "added_percent": round(statistics.median(added), 2),
            "added_ratio": round(statistics.median(by / one["encoder"] for by, one in zip(added, rounds)), 3)}


def report(slices: list[dict[str, Any]]) -> list[dict[str, Any]]:
    rows = []
    for codec in CODECS:
        mine = [one for one in slices if one["codec"] == codec]
        latency = [value for one in mine for value in one["latency_ms"]]
        rows.append({"codec": codec, "frames": len(latency), "p50_ms": round(percentile(latency, 50), 2),
                     "p99_ms": round(percentile(latency, 99), 2), "max_ms": round(max(latency), 2),
                     "sender_percent": round(statistics.median(one["sender_percent"] for one in mine), 2),
                     "encoder_percent": round(statistics.median(one["encoder_percent"] for one in mine), 2),
                     "sender_ratio": round(statistics.median(one["sender_percent"] / one["encoder_percent"]
                                                             for one in mine), 2),
                     "decode_percent": round(statistics.median(one["decode_percent"] for one in mine), 2)})
    return rows


def table(rows: list[dict[str, Any]]) -> None:
    heads = [("p50", "ms"), ("p99", "ms"), ("sender", "CPU %"), ("encoder", "CPU %"), ("ratio", ""),
             ("ddxdecode", "CPU %")]
    for line, title in enumerate((f"stream, CIF 25, {BITRATE} kbit/s", "")):
        say(f"{title:34}" + "".join(f"{head[line]:>9}" for head in heads))
    for row in rows:
        over = [what for what, value, limit in (("p50", row["p50_ms"], LIMIT_P50_MS),
                                                 ("sender", row["sender_percent"], LIMIT_SENDER_PERCENT))
                if value > limit]
        say(f"{row['codec']:34}{row['p50_ms']:9.2f}{row['p99_ms']:9.2f}{row['sender_percent']:9.2f}"
            f"{row['encoder_percent']:9.2f}{row['sender_ratio']:9.2f}{row['decode_percent']:9.2f}"
            + (f"   over the limit: {', '.join(over)}" if over else ""))


def measure(rounds: int, plan: Plan) -> dict[str, Any]:
    """Needs a network namespace with multicast over the loopback."""
    slices, protections = [], []
    for _ in range(rounds):
        for codec in CODECS:
            with scratch() as folder:
                slices.append({**slice_of(codec, folder, plan), "encoder_percent": alone(codec, plan)})
        with scratch() as folder:
            encoder = [str(ENCODE), str(plan.clip), "h264", str(BITRATE)]
            protections.append(protection(folder, plan.clip, encoder, BITRATE, (plan.warm_up, plan.seconds)))
    rows, cost = report(slices), report_protection(protections)
    table(rows)
    say("sender at 30 % loss: {plain_percent} %, with repair, reports and SRTP {protected_percent} %: {added_percent} "
        "more, {added_ratio} of the encoder's {encoder_percent} %".format(**cost))
    return {"stream": rows, "protection": cost}


def main() -> int:
    options = command_line(__doc__, rounds=2, short=False)
    from bench.store import own_network
    if not os.environ.get("DDX_BENCH_INSIDE"):
        native.build()
        if not options.short:
            numbered("real", SECONDS)
    own_network()
    if options.short:
        with scratch() as folder:
            measure(1, short(folder))
        return 0
    found = measure(options.rounds, whole())
    save("stream", {"cores": len(cpus()), **found})
    return 0


if __name__ == "__main__":
    finish("bench", main)
