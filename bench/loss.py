# SPDX-License-Identifier: GPL-2.0-or-later
"""make bench: usable frames of a stream over a lossy link, compared with other ways to send video.

tools/bench loss [-seeds N] [-cases WORD+WORD,...] [-sender WORDS] [-receiver WORDS] [-short]

A case plays 60 s of a numbered clip (real, moving, drawn) from a robot to an operator, in network namespaces with a
relay between them that loses packets from the first one on; frames count from the third second on. The two directions
lose independently of each other, except with "outages together". Cases are compared with a run without loss. A case's
name lists its parameters: "ddxvideo, iid 30, real, reports, -wire 250, RTT 4 ms, seed 1"; -cases selects cases whose
name has all words of one of the lists. -sender, -receiver: more options of ddxvideosend and ddxdecode. Writes
output/bench/loss.json, and loss.html with pictures of the screen. -short: a second of a generated clip, for the gate;
writes no file and judges nothing.
"""
import pathlib
import shutil
import subprocess
from collections.abc import Iterator

from bench import loss_page
from bench.clips import RATE, numbered
from bench.loss_chromium import Chromium
from bench.loss_figures import WORSE
from bench.loss_gstreamer import BlockCode, Fec, Retransmission
from bench.loss_peers import OURS, Ours, Peer, Rist, Srt, Srt120
from bench.loss_run import COLUMNS, SECONDS, Case, Maker, Plan, Take, judge, take
from bench.measure import save
from parts.common import BadInput, Failed, command_line, finish, say, scratch
from parts.image import native
from parts.link.link import Link
from parts.media import clip as made_up

PEERS: list[type[Peer]] = [Ours, Srt, Srt120, Rist, Retransmission, Chromium, Fec, BlockCode]
# Options as users type them. With the last ones the video's rate is the same with and without loss, as long as repair
# leaves room for it: so a comparison with the run without loss shows what arrived, not another rate.
DEFAULT, NARROW, CAPPED = "", "-wire 250", "-wire 250 -bitrate 130"
ONE_WAY = "-wire 250 -repair 2.2"
CLIPS = ["real", "moving", "drawn"]
SEEDS, FEW_SEEDS = 5, 2
AT = 6 * RATE  # the frame that the page shows
ATTEMPTS = 3
SHORT = Plan(3, 0.4)
SHORT_CASE = Case(OURS, "iid 30", "short")


def plan(seeds: int) -> Iterator[Case]:
    """All cases with loss."""
    few = range(1, min(seeds, FEW_SEEDS) + 1)
    for options in (DEFAULT, NARROW):
        for seed in range(1, seeds + 1):
            for name in CLIPS:
                yield from (Case(OURS, column, name, seed, options=options) for column in COLUMNS)
        yield from (Case(OURS, "iid 30", "real", seed, join=True, options=options) for seed in few)
    for seed in few:
        yield from (Case(OURS, column, "real", seed, options=CAPPED) for column in COLUMNS)
        yield from (Case(OURS, column, "real", seed, rtt_ms=10, options=NARROW) for column in COLUMNS)
        yield from (Case(OURS, column, "real", seed, operators=4, options=NARROW) for column in COLUMNS)
        yield from (Case(OURS, column, "real", seed, False, options=ONE_WAY) for column in COLUMNS)
        for peer in PEERS:
            if peer is not Ours:
                yield from (Case(peer.name, column, "real", seed, peer.reports) for column in COLUMNS)


def chosen(cases: Iterator[Case], words: str) -> list[Case]:
    lists = [one.split("+") for one in words.split(",")]
    found = [case for case in cases if any(all(word in str(case) for word in one) for one in lists)]
    if not found:
        raise BadInput(f"no case has all words of one of the lists {words}")
    return found


def available(cases: list[Case]) -> list[Case]:
    """Cases whose peer is installed; prints a line for each peer that is not."""
    absent = {peer.name: peer.program for peer in PEERS if peer.program and not shutil.which(peer.program)}
    for name in sorted(absent.keys() & {case.peer for case in cases}):
        say(f"bench: {name} is left out: {absent[name]} is not installed (tools/setup bench)")
    return [case for case in cases if case.peer not in absent]


def makers(sender: str, receiver: str) -> dict[str, Maker]:
    """For each peer; `sender` and `receiver`: more options of ours."""
    def other(kind: type[Peer]) -> Maker:
        return lambda link, clip, folder, _: kind(link, clip, folder)

    def ours(link: Link, clip: pathlib.Path, folder: pathlib.Path, case: Case) -> Peer:
        return Ours(link, clip, folder, [*case.options.split(), *sender.split()], receiver.split())

    return {**{peer.name: other(peer) for peer in PEERS}, OURS: ours}


class Bench:
    """Runs cases, each after its run without loss."""

    def __init__(self, made: dict[str, Maker], clips: dict[str, pathlib.Path], when: Plan = Plan()) -> None:
        self.made, self.clips, self.when = made, clips, when
        self.clean: dict[tuple[object, ...], dict[int, float]] = {}
        self.rows: list[dict[str, object]] = []
        self.screens: loss_page.Screens = {}
        self.failed: list[str] = []

    def run(self, case: Case) -> None:
        if case.reference not in self.clean:
            self.clean[case.reference] = {}
            self._run(case.clean)
        if self.clean[case.reference]:
            self._run(case)

    def _run(self, case: Case) -> None:
        try:
            found = self._take(case)
            if case == case.clean:
                self.clean[case.reference] = found.views[0].best()
            row = judge(found, self.clean[case.reference])
        except (Failed, OSError, subprocess.SubprocessError) as error:
            self.failed.append(f"{case}: {error}")
            say(f"bench: {self.failed[-1]}")
            return
        self.rows.append(row)
        say(f"{case}: usable {row['usable']} %, whole {row['whole']} %, shown {row['shown']} %, {row['screen_db']} dB, "
            f"{row['wire_kbit']} kbit/s, p50 {row['p50_ms']} ms, p99 {row['p99_ms']} ms, longest "
            f"{row['longest_ms']} ms")
        self._keep_screen(found)

    def _take(self, case: Case) -> Take:
        """Repeat a run that other load on the machine disturbed."""
        for _ in range(ATTEMPTS):
            found = take(case, self.made[case.peer], self.clips[case.clip], self.when)
            if not found.disturbed():
                return found
            say(f"{case}: disturbed, {found.pause_ms():.0f} ms between two frames, packets late by "
                f"{found.wire['late_ms']:.0f} ms")
        return found

    def _keep_screen(self, found: Take) -> None:
        """Keep one picture of the real clip, from the first seed; a receiver that joins shows nothing new."""
        case, view = found.case, found.views[0]
        if case.clip == "real" and case.seed == 1 and not case.join and AT in view.written:
            source, name = view.source[AT], loss_page.title(self.rows[-1])
            self.screens.setdefault(loss_page.SOURCE, loss_page.Screen(loss_page.jpeg(source), f"frame {AT}"))
            self.screens[name, case.column] = loss_page.screen(view.screen(AT), source)


def short(made: dict[str, Maker]) -> int:
    with scratch() as folder:
        path = made_up.write(folder / "short.y4m", int(SHORT.seconds))
        bench = Bench(made, {"short": path}, SHORT)
        bench.run(SHORT_CASE)
        loss_page.print_table(bench.rows)
        loss_page.page(bench.rows, bench.screens, "")
    return 1 if bench.failed else 0


def main() -> int:
    options = command_line(__doc__, seeds=SEEDS, cases="", sender="", receiver="", short=False)
    native.build()
    made = makers(options.sender, options.receiver)
    if options.short:
        return short(made)
    wanted = available(chosen(plan(options.seeds), options.cases))
    bench = Bench(made, {name: numbered(name, int(SECONDS)) for name in sorted({case.clip for case in wanted})})
    for case in wanted:
        bench.run(case)
    loss_page.print_table(bench.rows)
    about = (f"CIF, {RATE} frames a second, ddxvideosend {options.sender}; usable: within "
             f"{Ours.deadline_ms} ms and {WORSE:g} dB of the run without loss")
    path = save("loss", {"about": about, "rows": bench.rows, "failed": bench.failed})
    path.with_suffix(".html").write_text(loss_page.page(bench.rows, bench.screens, about))
    return 1 if bench.failed else 0


if __name__ == "__main__":
    finish("bench", main)
