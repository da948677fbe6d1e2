# SPDX-License-Identifier: GPL-2.0-or-later
"""The costs of the panel on this machine's own kernel: memory and processor time of all its parts, without a visitor
and with one that watches; the age of a picture when it is drawn; the bytes of a visit; the time of pages with a fifth
of a processor; the bytes that the panel adds to the image."""
from __future__ import annotations

import pathlib
import re
import shutil
from collections.abc import Callable

import pytest

from parts.common import run
from parts.guest import panel
from parts.guest.native_machine import NativeMachine
from parts.guest.panel import PASSPHRASE, Visitor
from parts.image import rootfs
from parts.media.browser import Browser

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

# ms from a tap until another page's frame is drawn, with the files that it fetches.
TURN = """(async () => {
    const begin = performance.now();
    document.querySelector("nav a[href='#PAGE']").click();
    do await new Promise(requestAnimationFrame);
    while (document.querySelector("nav a[aria-current]").hash !== "#PAGE"
        || document.body.innerText.includes("Loading ..."));
    await new Promise(requestAnimationFrame);
    return performance.now() - begin;
})()"""
PAGES = ("services", "picture", "recordings", "streams", "messages", "report", "machine", "health")
PART = 5  # of a processor, a fifth
PAINT = "(performance.getEntriesByName('first-contentful-paint')[0] || {}).startTime"
# Files of the panel's parts in the image.
PARTS = re.compile(r"lighttpd|mbed|mdns|panel")
MOST = 1 << 20  # bytes that it may add


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


def test_pages_with_a_fifth_of_a_processor(root: pathlib.Path, tmp_path: pathlib.Path,
                                           record_property: Callable[[str, object], None]) -> None:
    with panel.filming(root, tmp_path / "machine") as robot, Visitor(
            robot, tmp_path / "browser", panel.certificate(robot)) as visitor:
        browser = visitor.browser
        assert isinstance(browser, Browser)
        visitor.open()
        visitor.sees("document.getElementById('passphrase')")
        browser.screen(360, 640)
        browser.slow(PART)
        painted = []
        for number in range(5):
            visitor.open(f"{panel.ADDRESS}?{number}")
            visitor.sees(f"location.search === '?{number}' && document.getElementById('passphrase') && {PAINT}")
            painted.append(round(browser.value(PAINT)))
        record_property("first_paint_ms", sorted(painted))
        visitor.logs_in(PASSPHRASE)
        visitor.reads("checked now")
        for times in ("first", "second"):
            record_property(f"{times}_visit_of_each_page_ms",
                            {page: round(browser.value(TURN.replace("PAGE", page))) for page in PAGES})


def squashed(root: pathlib.Path) -> int:
    image = root.with_name("image")
    rootfs.pack(root, image)
    return image.stat().st_size


def test_what_the_panel_adds_to_the_image(root: pathlib.Path, tmp_path: pathlib.Path,
                                          record_property: Callable[[str, object], None]) -> None:
    copy = tmp_path / "root"
    run(["cp", "-a", root, copy])
    shutil.copy(root.with_name("boot-files.actions"), tmp_path)
    sizes = [squashed(copy)]
    own = [path for path in copy.rglob("*") if PARTS.search(str(path.relative_to(copy))) and not path.is_dir()]
    needed = {name for path in own for name in re.findall(rb"lib[\w.+-]+\.so[\d.]*", path.read_bytes())}
    for path in own:
        path.unlink()
    sizes.append(squashed(copy))
    programs = [path.read_bytes() for path in copy.rglob("*") if path.is_file() and not path.is_symlink()]
    left = [path for path in copy.rglob("*.so*") if path.name.encode() in needed]
    # Libraries that nothing else needs, only Debian's lighttpd, not Buildroot's; their own name is in them.
    alone = [path for path in left if sum(path.name.encode() in data for data in programs) <= 1]
    for path in alone:
        path.unlink()
    sizes.append(squashed(copy))
    record_property("added_bytes", sizes[0] - sizes[1])
    record_property("added_bytes_of_libraries", {" ".join(sorted(path.name for path in alone)): sizes[1] - sizes[2]})
    assert 0 < sizes[0] - sizes[1] <= MOST
