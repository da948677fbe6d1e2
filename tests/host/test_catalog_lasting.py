# SPDX-License-Identifier: GPL-2.0-or-later
"""Catalogs running for long, and many of them. pytest's option `--seconds` shortens the runs."""
from __future__ import annotations

import json
import os
import pathlib
import re

import pytest

from lib.figures import Figure
from parts.link.link import Link
from parts.link.loss import NOTHING, Iid

from .programs import Compiler, Process, lost, wait_until
from .test_catalog import Machine, begin, link, machines, read, write

pytestmark = pytest.mark.retry

__all__ = ["begin", "link", "machines"]  # fixtures

PARTITIONS, SUBSCRIPTIONS = 1000, 10000  # in ten minutes
SECONDS = 600
AWAY = 10      # each tenth partition lasts until the machines report each other as away
TOGETHER = 100  # simultaneous subscriptions
GROWTH = 1536  # KiB after the first quarter: DDS keeps up to 2,048 message buffers for reuse
MACHINES = 30
MEMORY = 12288  # KiB of private memory of each catalog
Look = dict[str, tuple[int, int]]  # for each program: KiB of private memory, open files


def look(process: Process) -> tuple[int, int]:
    status = pathlib.Path(f"/proc/{process.pid}/status").read_text()
    found = re.search(r"RssAnon:\s+(\d+) kB", status)
    assert found
    return int(found[1]), len(os.listdir(f"/proc/{process.pid}/fd"))


def look_at(both: tuple[Machine, Machine]) -> Look:
    return {machine.name: look(machine.catalog) for machine in both}


def grown(looks: list[Look]) -> list[str]:
    """Programs that hold more at the end than after the first quarter; files opened briefly do not count."""
    quarter = len(looks) // 4
    first, last = looks[quarter:2 * quarter], looks[-quarter:]
    return [f"{name}: {[one[name] for one in looks]}" for name in looks[0]
            if min(one[name][0] for one in last) > min(one[name][0] for one in first) + GROWTH
            or min(one[name][1] for one in last) > min(one[name][1] for one in first)]


def test_growth_is_detected() -> None:
    def looks(*steady: tuple[int, int]) -> list[Look]:
        return [{"robot": (4000, 9)}, *({"robot": one} for one in steady)]

    assert grown(looks(*[(5000, 10 + i % 2) for i in range(15)])) == []
    assert grown(looks(*[(5000 + 250 * i, 10) for i in range(15)])) != []
    assert grown(looks(*[(5000, 10 + i // 4) for i in range(15)])) != []


@pytest.mark.strict
@pytest.mark.long
def test_a_thousand_partitions(machines: tuple[Machine, Machine], link: Link, pytestconfig: pytest.Config,
                               record_property: Figure) -> None:
    """Values flow again after each partition; one of ten lasts until the lease has expired."""
    robot, laptop = machines
    writer, reader = robot.start("write", "sensor"), laptop.start("read", "robot", "sensor")
    written, looks = 1, list[Look]()
    write(writer, 1)
    read(reader, 1)
    for number in range(PARTITIONS * int(pytestconfig.getoption("seconds")) // SECONDS):
        link.lose(Iid(1.0))
        if number % AWAY == 0:
            wait_until(lambda: robot.desk.readers("sensor") == 0)
            looks.append(look_at(machines))
        write(writer, 2)
        link.lose(NOTHING)
        write(writer, 1)
        written += 3
        newest = written.to_bytes(4, "little").hex()
        while not read(reader, 1)[0].startswith(newest):
            pass
    wait_until(lambda: bool(laptop.counters()["in"] == robot.counters()["out"]))
    for machine in machines:
        counters = machine.counters()
        assert counters["in"] == counters["out"] + lost(counters)
        record_property(machine.name, {"in": counters["in"], "lost": counters["lost"],
                                       "KiB, files": [looks[len(looks) // 4][machine.name], looks[-1][machine.name]]})
    assert grown(looks) == []


def readers(machine: Machine) -> int:
    """The number of readers of the items i0, i1, ..."""
    items = json.loads(machine.desk.run("ddxctl", "list", "--json").stdout)["items"]
    return sum(one["readers"] for one in items if re.fullmatch("i[0-9]+", one["name"]))


@pytest.mark.strict
@pytest.mark.long
def test_ten_thousand_subscriptions(machines: tuple[Machine, Machine], pytestconfig: pytest.Config,
                                    record_property: Figure) -> None:
    """A hundred items at a time; each is subscribed again once it has no subscriber."""
    robot, laptop = machines
    read(robot.start("items", str(TOGETHER)), 1)
    looks = list[Look]()
    rounds = SUBSCRIPTIONS * int(pytestconfig.getoption("seconds")) // SECONDS // TOGETHER
    for _ in range(rounds):
        visitor = laptop.start("visit", "robot", str(TOGETHER))
        assert visitor.communicate(timeout=120)[0] == f"{TOGETHER}\n"
        wait_until(lambda: readers(robot) == 0)
        looks.append(look_at(machines))
    wait_until(lambda: bool(robot.counters()["out"] >= rounds * TOGETHER))
    for machine in machines:
        counters = machine.counters()
        assert lost(counters) == 0
        record_property(machine.name, {"in": counters["in"],
                                       "KiB, files": [looks[len(looks) // 4][machine.name], looks[-1][machine.name]]})
    assert grown(looks) == []


@pytest.mark.long
def test_thirty_machines(tmp_path: pathlib.Path, compile_client: Compiler, record_property: Figure) -> None:
    """Each has its own network namespace, knows all others by name, and reads an item of the next machine."""
    with Link(operators=MACHINES - 1, meet=True) as switch:
        client, all_machines = compile_client("catalog_client"), list[Machine]()
        try:
            for number, node in enumerate((switch.robot, *switch.operator)):
                all_machines.append(Machine(tmp_path / str(number), f"m{number}", node, client))
            meet(all_machines)
            memory = sorted(look(machine.catalog)[0] for machine in all_machines)
        finally:
            for machine in all_machines:
                machine.end()
    record_property("KiB of each", [memory[0], memory[-1]])
    assert memory[-1] <= MEMORY


def meet(all_machines: list[Machine]) -> None:
    names = {machine.name for machine in all_machines}
    for number, machine in enumerate(all_machines):
        write(machine.start("write", "sensor"), number + 1)
    for number, machine in enumerate(all_machines):
        other = (number + 1) % len(all_machines)
        value, = read(machine.start("read", f"m{other}", "sensor"), 1)
        assert value.startswith((other + 1).to_bytes(4, "little").hex())
    for machine in all_machines:
        wait_until(lambda: {f"{name}:sensor" for name in names - {machine.name}} <= seen(machine)["items"])
        found = seen(machine)
        assert found["heard"] == names - {machine.name} and machine.shown()["name"] == machine.name
        assert (machine.shown()["same"], machine.shown()["refused"]) == (0, 0)


def seen(machine: Machine) -> dict[str, set[str]]:
    shown = machine.shown()
    return {"heard": {one["name"] for one in shown["machines"] if one["heard"]},
            "items": {one["name"] for one in shown["items"] if one["heard"]}}
