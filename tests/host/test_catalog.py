# SPDX-License-Identifier: GPL-2.0-or-later
"""Catalogs link the stores of two machines, each in its own network namespace."""
from __future__ import annotations

import json
import pathlib
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from parts.common import TOP
from parts.link.link import Link, Node
from parts.link.loss import NOTHING, Iid

from .programs import ROOT, Compiler, Counters, Desk, Process, library_folder, lost, stop, wait_until

pytestmark = pytest.mark.retry

VALUES = 200
STEP = 4  # values at a time: fewer than are kept for a reader that missed some
KEPT = 8  # small values, for readers that missed them


# Runs a program with a clock that is ahead.
AHEAD = 1000
SHIFTED = (sys.executable, "-c", f"""
import ctypes, os, sys
CLOCK, libc = 0x80, ctypes.CDLL(None)
assert not libc.unshare(CLOCK)
open("/proc/self/timens_offsets", "w").write("monotonic {AHEAD} 0")
assert not libc.setns(os.open("/proc/self/ns/time_for_children", os.O_RDONLY), CLOCK)
os.execvp(sys.argv[1], sys.argv[1:])
""")


class Machine:
    """A store and its catalog in the node's network."""

    def __init__(self, folder: pathlib.Path, name: str, node: Node, client: pathlib.Path,
                 clock: tuple[str, ...] = (), rules: str = "") -> None:
        folder.mkdir()
        (folder / "exports.conf").write_text(rules)
        self.name, self.client, self.desk = name, client, Desk(folder)
        self._inside = (*node.inside, *clock)
        self.catalog = self.start_catalog()

    def end(self) -> None:
        self.catalog.kill()  # on TERM it would wait a second for unconfirmed data
        self.desk.end()

    def start_catalog(self) -> Process:
        catalog = self.desk.start("ddxcatalog", "-machine", self.name, "-c", "exports.conf", wrapper=self._inside)
        wait_until(lambda: self.desk.item("catalog.answer").get("writer_pid") == catalog.pid)
        return catalog

    def start(self, *words: str) -> Process:
        with open(self.desk.folder / "client", "a") as errors:
            process = subprocess.Popen([*self._inside, self.client, *words], env=self.desk.environment, text=True,
                                       stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors)
        self.desk.processes.append(process)
        return process

    def table(self) -> dict[str, Any]:
        """The catalog's table of itself and of other machines."""
        shown = self.desk.run("ddxctl", "show", "catalog.machines", "--json").stdout
        return dict(json.loads(shown)["value"]) if shown else {"name": "", "machine": []}

    def shown(self) -> dict[str, Any]:
        text = self.desk.run("ddxctl", "catalog", "--json").stdout
        return dict(json.loads(text)) if text else {"machines": [], "items": [], "refused": 0}

    def time(self, item: str) -> int:
        """The time of the newest value, ns."""
        return int(json.loads(self.desk.run("ddxctl", "show", item, "--json").stdout)["time_ns"])

    def counters(self) -> Counters:
        return self.desk.stats("ddxcatalog")


def write(writer: Process, count: int) -> None:
    assert writer.stdin and writer.stdout
    writer.stdin.write(f"{count}\n")
    writer.stdin.flush()
    assert writer.stdout.readline()


def read(reader: Process, count: int) -> list[str]:
    assert reader.stdout
    lines = [reader.stdout.readline() for _ in range(count)]
    assert all(lines), "the reader has stopped"
    return lines


@pytest.fixture
def link() -> Iterator[Link]:
    with Link() as link:
        yield link


Begin = Callable[..., tuple[Machine, Machine]]


@pytest.fixture
def begin(tmp_path: pathlib.Path, link: Link, compile_client: Compiler) -> Iterator[Begin]:
    client, both = compile_client("catalog_client"), list[Machine]()

    def begin(*names: str, clock: tuple[str, ...] = (), rules: str = "") -> tuple[Machine, Machine]:
        """Start two machines; the first one has this clock and these rules."""
        both.append(Machine(tmp_path / "0", names[0], link.robot, client, clock, rules))
        both.append(Machine(tmp_path / "1", names[1], link.operator[0], client))
        return both[0], both[1]

    yield begin
    for machine in both:
        machine.end()


@pytest.fixture
def machines(begin: Begin) -> tuple[Machine, Machine]:
    return begin("robot", "laptop")


@pytest.mark.strict
def test_a_mirror_equals_its_origin_byte_for_byte(machines: tuple[Machine, Machine]) -> None:
    robot, laptop = machines
    writer = robot.start("write", "sensor")
    write(writer, 3)
    here, there = robot.start("read", "-", "sensor"), laptop.start("read", "robot", "sensor")
    first = read(there, 1)
    assert first == read(here, 1)  # the newest value
    for _ in range(VALUES // STEP):
        write(writer, STEP)
        assert read(there, STEP) == read(here, STEP)
    assert laptop.desk.item("robot:sensor")["type"] == "SENSOR"
    wait_until(lambda: [one.counters()["in"] for one in machines] == [VALUES + 1] * 2)
    for one in machines:
        status, counters = stop(one.catalog)
        assert status == 0 and counters["in"] == counters["out"] == VALUES + 1 and lost(counters) == 0


def test_a_picture_of_another_machine(begin: Begin, tmp_path: pathlib.Path) -> None:
    """The store has no memory for the unused parts of its planes."""
    clip = tmp_path / "clip.y4m"
    clip.write_bytes(b"YUV4MPEG2 W64 H48 F25:1\nFRAME\n" + bytes(range(256)) * (64 * 48 * 3 // 2 // 256))
    robot, laptop = begin("robot", "laptop", rules="item video\n")
    assert robot.desk.run("ddxvideoload", clip).returncode == 0
    wait_until(lambda: "robot:video" in [one["name"] for one in laptop.shown()["items"]])
    shown = [json.loads(machine.desk.run("ddxctl", "show", name, "--json").stdout)["value"]
             for machine, name in ((robot, "video"), (laptop, "robot:video"))]
    assert shown[0] == shown[1] and shown[0]["width"] == 64


@pytest.mark.strict
def test_values_whose_layout_changes_are_whole(machines: tuple[Machine, Machine]) -> None:
    """A reader may subscribe after a change that the catalog has not noticed yet."""
    robot, laptop = machines
    writer = robot.start("extents", "bytes")

    def shown() -> dict[str, Any]:
        done = laptop.desk.run("ddxctl", "show", "robot:bytes", "--json")
        value = dict(json.loads(done.stdout)["value"]) if done.returncode == 0 else {}
        assert not value or len(value["byte"]) == value["count"] == value["last"], value
        return value

    wait_until(lambda: "robot:bytes" in [one["name"] for one in laptop.shown()["items"]])
    for _ in range(3):
        shown()
    assert writer.stdin and writer.stdout
    writer.stdin.close()
    last = int(writer.stdout.readline())
    wait_until(lambda: shown().get("count") == last)


def test_ddxctl_shows_machines_and_mirrors(machines: tuple[Machine, Machine]) -> None:
    robot, laptop = machines
    write(robot.start("write", "sensor"), 1)
    read(laptop.start("read", "robot", "sensor"), 1)

    def readers(machine: Machine, item: str) -> list[int]:
        return [one["readers"] for one in machine.shown()["items"] if one["name"] == item and one["heard"]]

    wait_until(lambda: readers(robot, "sensor") == readers(laptop, "robot:sensor") == [1])
    shown = laptop.shown()
    assert (shown["name"], shown["same"], shown["more"]) == ("laptop", 0, 0)
    assert [(one["name"], one["heard"]) for one in shown["machines"]] == [("robot", True)]
    text = laptop.desk.run("ddxctl", "catalog").stdout
    unknown = laptop.desk.run("ddxctl", "show", "carol:gps")
    assert unknown.returncode == 1 and "no machine of this name is known to the catalog" in unknown.stderr
    assert re.search("^robot +heard +[0-9]+ ", text, re.M) and re.search("^robot:sensor +SENSOR +heard +1$", text, re.M)


def test_ddxctl_without_a_catalog(desk: Desk) -> None:
    shown = desk.run("ddxctl", "catalog")
    assert shown.returncode == 1 and "no catalog runs here" in shown.stderr


def test_nothing_is_sent_without_a_reader(machines: tuple[Machine, Machine], link: Link) -> None:
    """The link counts the packets."""
    robot, laptop = machines

    def packets() -> int:
        return link.counts().down[0].packets

    writers = {name: robot.start("write", name) for name in ("left", "sensor")}
    readers = {name: laptop.start("read", "robot", name) for name in writers}
    for name in writers:
        write(writers[name], 1)
        read(readers[name], 1)
    readers["left"].kill()
    before = packets()
    for _ in range(VALUES // STEP):
        write(writers["sensor"], STEP)
        read(readers["sensor"], STEP)
    assert packets() - before >= VALUES
    wait_until(lambda: robot.desk.readers("left") == 0)
    before, taken = packets(), robot.counters()["in"]
    write(writers["left"], VALUES)
    assert packets() - before < VALUES / 4  # only announcements of the machines
    assert robot.counters()["in"] == taken
    assert robot.desk.readers("left") == 0
    assert laptop.desk.item("robot:left")["writer_pid"] == 0  # a program may hold only a few hundred writers
    read(laptop.start("read", "robot", "left"), 1)


@pytest.mark.strict
def test_values_lost_on_the_way_are_sent_again_or_counted(machines: tuple[Machine, Machine], link: Link) -> None:
    robot, laptop = machines
    writer = robot.start("write", "sensor")
    reader = laptop.start("read", "robot", "sensor")
    write(writer, 1)
    first = read(reader, 1)
    link.lose(Iid(0.2))
    seen = first
    for _ in range(40 // STEP):
        write(writer, STEP)
        seen += read(reader, STEP)
    link.lose(Iid(1.0))
    before = link.counts().down[0].lost
    write(writer, 20)
    wait_until(lambda: link.counts().down[0].lost >= before + 20)
    link.lose(NOTHING)
    write(writer, 1)
    while not seen[-1].startswith("3e000000"):  # 62
        seen += read(reader, 1)
    wait_until(lambda: bool(laptop.counters()["in"] == 62))
    counters = laptop.counters()
    assert counters["in"] == counters["out"] + counters["lost"]["network"]
    assert len(set(seen)) == len(seen) == counters["out"] >= 41 + KEPT
    assert counters["lost"]["network"] >= 10  # of 21 values the writer kept eight, and sent one or two after the outage


@pytest.mark.parametrize("end", [0, 1])
def test_a_restarted_catalog_continues(machines: tuple[Machine, Machine], end: int) -> None:
    """Readers keep their open items."""
    robot, laptop = machines
    writer = robot.start("write", "sensor")
    reader = laptop.start("read", "robot", "sensor")
    write(writer, 1)
    read(reader, 1)
    machines[end].catalog.kill()
    machines[end].catalog.wait()
    machines[end].catalog = machines[end].start_catalog()
    wait_until(lambda: robot.desk.readers("sensor") == 1)
    write(writer, 3)
    while not read(reader, 1)[0].startswith("04000000"):
        pass  # values sent before the other end notices are lost


def test_mirrors_continue_after_a_partition(machines: tuple[Machine, Machine], link: Link) -> None:
    """The mirror keeps its last value during the partition."""
    robot, laptop = machines
    writer = robot.start("write", "sensor")
    reader = laptop.start("read", "robot", "sensor")
    write(writer, 1)
    read(reader, 1)
    link.lose(Iid(1.0))
    wait_until(lambda: robot.desk.readers("sensor") == 0)
    write(writer, 5)
    shown = laptop.desk.run("ddxctl", "show", "robot:sensor")
    assert shown.returncode == 0
    wait_until(lambda: [one["heard"] for one in laptop.shown()["machines"]] == [False])
    assert re.search("^robot +away +[0-9]+ ", laptop.desk.run("ddxctl", "catalog").stdout, re.M)
    link.lose(NOTHING)
    back = time.monotonic()
    assert read(reader, 1)[0].startswith("06000000")
    assert time.monotonic() - back < 10
    write(writer, 1)
    assert read(reader, 1)[0].startswith("07000000")


READ = """
import json, sys, ddx
with ddx.Store(sys.argv[1] or None, timeout=5.0) as store, store.item(sys.argv[2]) as item:
    assert item.read()["number"] == json.loads(sys.argv[3])["number"]
"""


def test_a_first_read_waits_for_the_subscription(machines: tuple[Machine, Machine], link: Link) -> None:
    """ddxctl and Python read the newest value, not the one from before the subscription; without one, its age."""
    robot, laptop = machines
    writer = robot.start("write", "sensor")

    def wait_for_no_reader() -> None:
        wait_until(lambda: robot.desk.readers("sensor") == 0)

    # A subscription that takes a busy machine over a second gives the last value with its age, or none. As long as it
    # lasts, no other value comes, so each attempt begins after its end.
    def value(machine: Machine, item: str) -> Any:
        for _ in range(5):
            shown = machine.desk.run("ddxctl", "show", item, "--json")
            if "no new value within 1 s" not in shown.stderr and "nothing was written yet" not in shown.stderr:
                break
            wait_for_no_reader()
        assert shown.returncode == 0, shown.stderr
        return json.loads(shown.stdout)["value"]

    def python(host: str, item: str, wanted: Any, attempts: int = 5) -> str:
        environment = {**laptop.desk.environment, "PYTHONPATH": str(TOP / "package/ddx/python")}
        for attempt in range(attempts):
            if attempt:
                wait_for_no_reader()
            done = subprocess.run(["/usr/bin/python3", "-B", "-c", READ, host, item, json.dumps(wanted)], timeout=60,
                                  env=environment, capture_output=True, text=True)
            if "no new value" not in done.stderr:
                break
        assert done.returncode == 0, done.stderr
        return done.stderr

    write(writer, 1)
    wait_until(lambda: "robot:sensor" in [one["name"] for one in laptop.shown()["items"]])
    assert value(laptop, "robot:sensor") == value(robot, "sensor")
    wait_for_no_reader()
    write(writer, 1)
    assert value(laptop, "robot:sensor") == value(robot, "sensor")
    wait_for_no_reader()
    write(writer, 1)
    assert python("robot", "sensor", value(robot, "sensor")) == ""
    wait_for_no_reader()
    last = value(robot, "sensor")
    link.lose(Iid(1.0))
    write(writer, 1)
    shown = laptop.desk.run("ddxctl", "show", "robot:sensor")
    assert shown.returncode == 0 and re.search(r"no new value within 1 s; the last one is [0-9.]+ s old", shown.stderr)
    assert "no new value; the last one is" in python("", "robot:sensor", last, 1)


def test_the_later_of_two_machines_with_one_name_takes_another(begin: Begin, tmp_path: pathlib.Path) -> None:
    first, second = begin("carol", "carol")
    wait_until(lambda: [len(one.table()["name"]) for one in (first, second)] == [5, 10])
    name = second.table()["name"]
    assert re.fullmatch("carol-[0-9a-f]{4}", name)
    write(second.start("write", "sensor"), 1)
    assert read(first.start("read", name, "sensor"), 1)[0].startswith("01000000")
    assert second.desk.run("ddxctl", "show", f"{name}:sensor").returncode == 1  # no loop
    first.catalog.kill()
    first.catalog.wait()
    first.catalog = first.start_catalog()
    wait_until(lambda: [one.table().get("same") for one in (first, second)] == [1, 1])
    assert (first.table()["name"], second.table()["name"]) == ("carol", name)

    (tmp_path / "sleep").symlink_to("/bin/true")
    screen = subprocess.run([TOP / "package/ddxservice/health"], text=True, capture_output=True, env={
        **second.desk.environment, "PATH": f"{tmp_path}:{ROOT / 'bin'}:/usr/bin:/bin"}, timeout=60)
    assert screen.returncode == 1
    assert f"! catalog    another machine is called carol, too; this one is {name} for others" in screen.stdout


def test_times_of_a_mirror_are_in_the_reader_s_clock(begin: Begin) -> None:
    """The clock of the mirrored robot is ahead."""
    robot, laptop = begin("robot", "laptop", clock=SHIFTED)
    writer = robot.start("write", "sensor")
    reader = laptop.start("read", "robot", "sensor")

    def clock() -> dict[str, Any]:
        machines = laptop.table()["machine"] or [{"offset": 0, "bound": -1}]  # not yet known
        return {name: machines[0][name] for name in ("offset", "bound")}

    def agrees() -> bool:
        before = clock()
        write(writer, 1)
        read(reader, 1)
        apart = robot.time("sensor") - laptop.time("robot:sensor")
        error = abs(apart - AHEAD * 10**9)
        return bool(0 <= before["bound"] and apart == before["offset"] and error <= clock()["bound"])

    wait_until(agrees)


@pytest.mark.strict
def test_values_not_sent_are_counted_once(begin: Begin) -> None:
    """The end that leaves them out counts them; the other end counts the values that were sent."""
    robot, laptop = begin("robot", "laptop", rules="bandwidth 8K\nitem slow rate=2\nitem *\n")
    writers = [robot.start("write", name) for name in ("sensor", "slow")]
    readers = [laptop.start("read", "robot", name) for name in ("sensor", "slow")]
    for writer, reader in zip(writers, readers):
        write(writer, 1)
        read(reader, 1)
        write(writer, VALUES)
    for reader in readers:  # the newest value comes once the rules allow it
        while not read(reader, 1)[0].startswith(f"{VALUES + 1:02x}000000"):
            pass

    def taken() -> int:
        return int((counters := robot.counters())["in"] + counters["skipped"])

    wait_until(lambda: taken() == 2 * (VALUES + 1))
    here = robot.counters()
    wait_until(lambda: bool(laptop.counters()["out"] == here["out"]))
    assert here["in"] == here["out"] + lost(here)
    assert here["lost"]["bandwidth"] > VALUES / 2 and here["skipped"] > VALUES / 2
    assert lost(laptop.counters()) == 0


def test_items_with_the_same_topic_name(machines: tuple[Machine, Machine]) -> None:
    robot, laptop = machines
    names = ("a.b", "a_b", "a-b", "a_", "a.")
    for count, name in enumerate(names, 1):
        write(robot.start("write", name), count)
    for count, name in enumerate(names, 1):
        assert read(laptop.start("read", "robot", name), 1)[0].startswith(f"{count:02x}000000")


@pytest.mark.strict
def test_a_machine_that_loses_its_address(machines: tuple[Machine, Machine], link: Link) -> None:
    """And gets it back, as after an expired lease. DDS alone would not notice."""
    robot, laptop = machines
    writer, reader = robot.start("write", "sensor"), laptop.start("read", "robot", "sensor")
    write(writer, 1)
    read(reader, 1)
    device = json.loads(link.robot.run(["ip", "-j", "address"], stdout=subprocess.PIPE).stdout)[1]["ifname"]
    address = ("address", "del", f"{link.robot.address}/24", "dev", device)
    link.robot.run(["ip", *address])
    wait_until(lambda: "the network cannot be used" in robot.desk.errors(robot.catalog))
    write(writer, 1)
    link.robot.run(["ip", address[0], "add", *address[2:]])
    while not read(reader, 1)[0].startswith("02000000"):
        pass
    write(writer, 1)
    assert read(reader, 1)[0].startswith("03000000")
    wait_until(lambda: bool(laptop.counters()["in"] == 3))  # the first value is not stored again
    assert lost(laptop.counters()) == lost(robot.counters()) == 0


@pytest.mark.parametrize("text,message", [
    ("items imu\n", "exports.conf:1: items: a line begins with item, except, accept, interface, peer, domain"),
    ("item\n", "exports.conf:1: after item, one word is needed"),
    ("# fine\nitem imu rate=fast\n", "exports.conf:2: rate=fast: a number above 0, up to 1000"),
    ("item imu every=2\n",
     "exports.conf:1: every=2: after item PATTERN, rate=VALUES_A_SECOND, latched, and as=MESSAGE"),
    ("item imu as=a/msg/B topic=/imu\n", "exports.conf:1: as=a/msg/B: not a known message"),
    ("item imu as=sensor_msgs/msg/Imu\n", "exports.conf:1: as=MESSAGE and topic=TOPIC are needed together"),
    ("item imu topic=/imu\n", "exports.conf:1: as=MESSAGE and topic=TOPIC are needed together"),
    ("item i* as=sensor_msgs/msg/Imu topic=/imu\n", "exports.conf:1: as= needs the name of one item, not a pattern"),
    ("item imu topic=imu\n", "exports.conf:1: topic=imu: /NAME is needed, or /NAME/NAME"),
    ("item imu topic=/imu topic=/x\n", "exports.conf:1: topic=/x: once in a line only"),
    ("except imu latched\n", "exports.conf:1: latched: after except PATTERN, nothing more is allowed"),
    ("accept /cmd_vel\n", "exports.conf:1: accept TOPIC as ITEM type=MESSAGE is needed"),
    ("accept /cmd_vel as cmd\n", "exports.conf:1: accept TOPIC as ITEM type=MESSAGE is needed"),
    ("accept /cmd_vel in cmd type=std_msgs/Int8\n", "exports.conf:1: accept TOPIC as ITEM type=MESSAGE is needed"),
    ("accept cmd as cmd type=std_msgs/Int8\n", "exports.conf:1: cmd: /NAME is needed, or /NAME/NAME"),
    ("accept /cmd as a:b type=std_msgs/Int8\n", "exports.conf:1: a:b: the name of an item of this machine is needed"),
    ("accept /cmd as cmd type=std_msgs/Int\n", "exports.conf:1: type=std_msgs/Int: not a known message"),
    ("bandwidth 5\n", "exports.conf:1: bandwidth 5: bytes a second are needed, from 1K to 1024M"),
    ("bandwidth 2000M\n", "exports.conf:1: bandwidth 2000M: bytes a second"),
    ("bandwidth 1M 2M\n", "exports.conf:1: after bandwidth, one word is needed"),
    ("domain 233\n", "exports.conf:1: domain 233: a whole number from 0 to 232"),
    ("\x1b]0;x\x07\n", "exports.conf:1: ?]0;x?: a line begins with"),
    ("bandwidth 1M\nitem b as=std_msgs/Float64 topic=/b/c\n"
     "item a rate=0.5 latched\nexcept b\nitem *\n"
     "accept /c as c type=std_msgs/msg/Int8\npeer 10.0.0.1\nmulticast no\n", None),
])
def test_rules_are_checked(tmp_path: pathlib.Path, text: str, message: str | None) -> None:
    (tmp_path / "exports.conf").write_text(text)
    done = subprocess.run([ROOT / "bin/ddxcatalog", "-c", "exports.conf", "-check"], cwd=tmp_path, capture_output=True,
                          text=True, timeout=60, env={"LD_LIBRARY_PATH": str(library_folder())})
    assert done.returncode == (2 if message else 0) and "\x1b" not in done.stderr
    assert done.stderr.startswith(f"ddxcatalog: {message}" if message else "")
    assert done.stderr.count("\n") == bool(message)
