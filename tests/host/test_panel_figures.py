# SPDX-License-Identifier: GPL-2.0-or-later
"""What the panel costs on this machine's own kernel: memory and processor time of all its parts, without a visitor and
with one that watches; how old a picture is when it is drawn; what a visit fetches."""
from __future__ import annotations

import pathlib
from collections.abc import Callable

import pytest

from parts.guest import panel
from parts.guest.native_machine import NativeMachine
from parts.guest.panel import PASSPHRASE, Visitor

pytestmark = [pytest.mark.retry, pytest.mark.long]

SECONDS = 60
# Of all parts and what they have started, with those that have exited: ms of processor time, KiB (Pss).
COST = """
parts=$(cat /run/service/ddxpanel/supervise/pid); parts="$parts $(pgrep -P $parts)"
for one in $parts; do parts="$parts $(pgrep -P $one)"; done
for one in $(printf '%s\\n' $parts | sort -u); do
    sed 's/.*) //' /proc/$one/stat; awk '/^Pss:/ { print "pss", $2 }' /proc/$one/smaps_rollup
done 2> /dev/null | awk -v tick=$(getconf CLK_TCK 2> /dev/null || echo 100) '
    $1 == "pss" { pss += $2; next } { ticks += $12 + $13 + $14 + $15 } END { print ticks * 1000 / tick, pss }'
"""
# The age that the page shows when it has drawn a picture.
WATCH = """
globalThis.ages = [];
new MutationObserver(() => {
    const age = / (\\d+) ms old/.exec(document.getElementById("state").textContent);
    if (age) ages.push(Number(age[1]));
}).observe(document.getElementById("picture"), { attributeFilter: ["data-frame"] });
"""
BYTES = "performance.getEntriesByType('resource').concat(performance.getEntriesByType('navigation'))"


def cost(robot: NativeMachine) -> tuple[float, int]:
    ms, pss = robot.sh(COST).split()
    return float(ms), int(pss)


def used(robot: NativeMachine) -> tuple[float, int]:
    """Processor time in ms over SECONDS, and KiB after them."""
    before = cost(robot)[0]
    robot.sh(f"sleep {SECONDS}")
    after, pss = cost(robot)
    return after - before, pss


def quantile(values: list[float], part: float) -> float:
    return sorted(values)[min(int(len(values) * part), len(values) - 1)]


def test_what_the_panel_costs(root: pathlib.Path, tmp_path: pathlib.Path,
                              record_property: Callable[[str, object], None]) -> None:
    with panel.filming(root, tmp_path / "machine") as robot:
        ms, pss = used(robot)
        record_property("no_session", {"ms_in_60_s": ms, "pss_KiB": pss})
        with Visitor(robot, tmp_path / "browser", panel.certificate(robot)) as visitor:
            visitor.open()
            visitor.sees("document.getElementById('passphrase')")
            fetched = f"{BYTES}.filter((one) => !one.name.includes('/panel/'))"
            record_property("first_page", {
                "requests": visitor.browser.value(f"{BYTES}.length"),
                "bytes": visitor.browser.value(f"{fetched}.reduce((sum, one) => sum + one.encodedBodySize, 0)")})
            visitor.logs_in(PASSPHRASE)
            visitor.reads("checked now")
            ms, pss = used(robot)
            record_property("health_page", {"ms_in_60_s": ms, "pss_KiB": pss})
            visitor.taps("document.querySelector('a[href=\"#picture\"]')")
            visitor.sees("document.getElementById('picture').dataset.frame")
            visitor.browser.value(WATCH)
            ms, pss = used(robot)
            record_property("one_viewer", {"ms_in_60_s": ms, "pss_KiB": pss})
            ages = [float(one) for one in visitor.browser.value("ages")]
            record_property("store_to_drawn_ms", {"p50": quantile(ages, 0.5), "p99": quantile(ages, 0.99),
                                                  "pictures": len(ages)})
            assert len(ages) > SECONDS
        robot.sh("ddxctl disable ddxpanel")
        robot.wait_until("! pgrep 'ddxpanel|lighttpd|mdnsd|ddxvideosnap'")
