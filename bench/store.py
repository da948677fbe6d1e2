# SPDX-License-Identifier: GPL-2.0-or-later
"""make bench: compare the store with other ways to pass frames, in one run.

tools/bench store [-rounds N] [-cases WORD,...] [-before COMMIT] [-short]

A round runs a slice of each peer in each case; the order changes from round to round, so that other load on the machine
affects all peers alike. docs/bench.md describes the figures. -cases: only cases whose name has one of the words.
-before: only our store, beside that of COMMIT. -short: a few frames, and only peers that are already built, for the
gate; writes no file.
"""
import dataclasses
import os
import pathlib
import platform
import shutil
import statistics
import subprocess
import sys
from typing import Any

from bench import plot as bench_plot
from bench.measure import (BEFORE, BUILD, Case, Slice, Starved, Store, cases, cpus, percentile, place, run_slice,
                           save)
from parts.common import OUTPUT, TOP, Failed, command_line, run, say, scratch
from parts.image import cargo, native

CARGO = OUTPUT / "bench/cargo"
INSIDE = "DDX_BENCH_INSIDE"  # set in our own network namespace


def compile_bench(root: pathlib.Path, into: pathlib.Path, options: list[str]) -> None:
    """Build the programs of bench/ with the store and the library that are installed in `root`."""
    options = [f"-Dddx_headers={root}/usr/include", f"-Dddx_libraries={root / native.LIBRARIES}", *options]
    run(["meson", "configure" if (into / "build.ninja").exists() else "setup", *options, into], cwd=TOP / "bench")
    run(["ninja", "-C", into])


def build(peers: bool) -> None:
    root = native.build()
    if not peers:
        compile_bench(root, BUILD, [] if (BUILD / "build.ninja").exists() else ["-Dpeers=false"])
        return
    say("bench: building iceoryx2 ...")
    run(["cargo", "build", "--release", "--locked", "--target-dir", CARGO],
        cwd=cargo.project(TOP / "bench/iceoryx2", OUTPUT / "bench/iceoryx2"))
    compile_bench(root, BUILD, ["-Dpeers=true", f"-Diceoryx2={CARGO}/release/libbench_iceoryx2.a"])


def build_before(commit: str) -> None:
    """Build the store and the library of another commit, and our benchmark program that uses them."""
    name = run(["git", "-C", TOP, "rev-parse", "--verify", f"{commit}^{{commit}}"]).strip()
    tree = BEFORE / name
    if not tree.exists():
        shutil.rmtree(BEFORE, ignore_errors=True)
        tree.mkdir(parents=True)
        archive = BEFORE / "tree.tar"
        run(["git", "-C", TOP, "archive", "-o", archive, name, "package/ddx"])
        run(["tar", "-xf", archive, "-C", tree])
    compile_bench(native.build("bench/before", (), ["ddx"], tree), BEFORE / "build", ["-Dpeers=false"])


def machine() -> dict[str, Any]:
    models = [line.split(":", 1)[1].strip() for line in pathlib.Path("/proc/cpuinfo").read_text().splitlines()
              if line.startswith("model name")]
    return {"cpu": models[0] if models else platform.machine(), "cores": len(cpus()), "kernel": platform.release(),
            "load_before": round(os.getloadavg()[0], 2)}


def run_unless_starved(case: Case, peer: str, folder: pathlib.Path, store: Store) -> Slice:
    """A slice that other programs left no processor has no figures and is repeated, up to three times."""
    for _ in range(3):
        try:
            return run_slice(case, peer, folder, store)
        except Starved as error:
            say(f"bench: {error}; again")
    return run_slice(case, peer, folder, store)


def measure(wanted: list[Case], rounds: int) -> tuple[dict[tuple[str, str], list[Slice]], dict[tuple[str, str], str]]:
    found: dict[tuple[str, str], list[Slice]] = {}
    failed: dict[tuple[str, str], str] = {}
    with scratch() as folder:
        own = {peer for case in wanted for peer in case.peers} & {"before"} | {"ddx"}
        for peer in own:
            (folder / peer).mkdir()
        stores = {peer: Store(folder / peer, peer) for peer in own}
        try:
            for number in range(rounds):
                say(f"bench: round {number + 1} of {rounds}")
                for case in wanted:
                    first = number % len(case.peers)
                    for peer in case.peers[first:] + case.peers[:first]:
                        at = peer if peer in stores else "ddx"
                        try:
                            found.setdefault((case.name, peer), []).append(
                                run_unless_starved(case, peer, folder / at, stores[at]))
                        except Failed as error:
                            if peer in (*stores, "futex"):
                                raise
                            failed[case.name, peer] = str(error)
        finally:
            for store in stores.values():
                store.end()
    return found, failed


def row(case: str, peer: str, slices: list[Slice]) -> dict[str, Any]:
    latency = [value for part in slices for value in part.latency]
    p50 = sorted(part.p50 for part in slices)
    return {"case": case, "peer": peer, "p50_us": round(percentile(latency, 50), 1),
            "p99_us": round(percentile(latency, 99), 1),
            "writer_cpu_us": round(statistics.median(part.writer_cpu for part in slices), 1),
            "reader_cpu_us": round(statistics.median(part.reader_cpu for part in slices), 1),
            "cpu_percent": round(statistics.median(part.percent for part in slices), 2),
            "p50_quartiles_us": [round(percentile(p50, 25), 1), round(percentile(p50, 75), 1)],
            "deliveries": len(latency), "lost": sum(part.lost for part in slices),
            "torn": sum(part.torn for part in slices), "queued_ms": round(sum(part.queued for part in slices), 1)}


def ratio(mine: list[Slice], theirs: list[Slice], what: str) -> float:
    """The median of the ratios of all rounds."""
    return float(statistics.median(getattr(a, what) / getattr(b, what) for a, b in zip(mine, theirs)))


def report(wanted: list[Case], found: dict[tuple[str, str], list[Slice]]) -> dict[str, Any]:
    rows = []
    for case in wanted:
        for peer in case.peers:
            slices = found.get((case.name, peer))
            mine = found[case.name, "ddx"]
            if not slices:
                continue
            one = row(case.name, peer, slices)
            if peer != "ddx":
                one["ddx_ratio"] = {"p50": round(ratio(mine, slices, "p50"), 2),
                                    "reader_cpu": round(ratio(mine, slices, "reader_cpu"), 2),
                                    "writer_cpu": round(ratio(mine, slices, "writer_cpu"), 2)}
            plain = found.get(("1080p-1x1-zerocopy", peer))
            if case.mode == "direct" and plain:
                one["over_acquire_us"] = round(statistics.median(a.p50 - b.p50 for a, b in zip(slices, plain)), 1)
            rows.append(one)
    return {"cases": rows}


def table(rows: list[dict[str, Any]]) -> None:
    say(f"{'':34}{'p50':>9}{'p99':>9}{'writer':>9}{'reader':>9}{'lost':>6}{'queued':>9}   ddx / peer")
    say(f"{'':34}{'us':>9}{'us':>9}{'CPU us':>9}{'CPU us':>9}{'':6}{'ms':>9}   p50  reader  writer")
    for one in rows:
        line = (f"{one['case']:25}{one['peer']:9}{one['p50_us']:9.1f}{one['p99_us']:9.1f}{one['writer_cpu_us']:9.1f}"
                f"{one['reader_cpu_us']:9.1f}{one['lost']:6}{one['queued_ms']:9.1f}")
        if "ddx_ratio" in one:
            parts = one["ddx_ratio"]
            line += f"   {parts['p50']:.2f}    {parts['reader_cpu']:.2f}    {parts['writer_cpu']:.2f}"
        if "over_acquire_us" in one:
            line += f"   {one['over_acquire_us']:+.1f} us over acquire"
        if one["case"].startswith("5x"):
            line += f"   {one['cpu_percent']:.1f} % of a core, all processes"
        say(line)


def own_network() -> None:
    """Move to an own network namespace: LCM's UDP multicast stays there, and no route of the machine changes."""
    if not os.environ.get(INSIDE):
        unshare = ["unshare", "--net"] if os.geteuid() == 0 else ["unshare", "--net", "--map-root-user"]
        os.execvpe(unshare[0], [*unshare, *sys.orig_argv], {**os.environ, INSIDE: "1"})
    for words in ("link set lo up multicast on", "route add 224.0.0.0/4 dev lo"):
        run(["ip", *words.split()])


def main() -> int:
    options = command_line(__doc__, rounds=10, cases="", before="", short=False)
    wanted = [case for case in cases() if any(word in case.name for word in options.cases.split(","))]
    if options.before:
        wanted = [dataclasses.replace(case, peers=("ddx", "before")) for case in wanted]
    try:
        if not os.environ.get(INSIDE):
            build(peers=not options.before and not options.short)
            if options.before:
                build_before(options.before)
        own_network()
        if options.short:
            # Slowly: on a machine that is busy with other tests, a reader may wait for its core for 200 ms and more.
            wanted = [dataclasses.replace(case, frames=40, interval=15000,
                                          peers=tuple(peer for peer in case.peers if place(peer)[1].exists()))
                      for case in wanted]
        about = machine()
        found, failed = measure(wanted, options.rounds)
    except (Failed, subprocess.SubprocessError) as error:
        say(f"bench: {error}")
        return 1
    result = {"machine": about, "rounds": options.rounds, **report(wanted, found),
              "left_out": [{"case": case.name, "peer": "lcm", "why": "has no zero copy"} for case in wanted
                           if case.mode == "zerocopy" and not options.before] +
                          [{"case": case, "peer": peer, "why": why} for (case, peer), why in failed.items()]}
    table(result["cases"])
    for (case, peer), why in failed.items():
        say(f"bench: {case}: {peer} failed in a slice: {why}")
    if not options.short:
        path = save("before" if options.before else "store", result)
        if not options.before:
            path.with_suffix(".html").write_text(bench_plot.page(result))
    torn = [one for one in result["cases"] if one["peer"] == "ddx" and one["torn"]]
    return 1 if torn else 0


if __name__ == "__main__":
    sys.exit(main())
