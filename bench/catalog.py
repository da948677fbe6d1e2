# SPDX-License-Identifier: GPL-2.0-or-later
"""make bench: cost and latency of the catalog, compared with Cyclone DDS alone. See docs/bench.md.

tools/bench catalog [-rows WORD,...] [-short]: four machines, each in its own network namespace, on the link of
tools/parts/link. Prints a table with the goals and writes output/bench/catalog.json. -rows: only rows whose name has
one of the words. -short: a few values of some rows, for the gate; writes no file and judges nothing.
"""
import dataclasses
import os
import pathlib
import statistics
import subprocess
import time
from collections.abc import Callable, Iterator
from typing import Any

from bench.catalog_machine import Machine, Reader, percent_while
from bench.measure import percentile, save
from parts.common import MORTAL, OUTPUT, TOP, Closing, Failed, command_line, finish, run, say, scratch, wait_until
from parts.image import native, peers
from parts.link.link import Link
from parts.link.loss import NOTHING, Iid
from parts.media import clip
from parts.processes import Client, kill
MARK = b"\xa5" * 64  # in each value of bench/catalog.c
RULES = "interface link0\nitem *\nitem video as=sensor_msgs/msg/Image topic=/image\n"
PROGRAMS = ["bin/ddxcatalog", "libexec/ddx/ctl-catalog", "libexec/ddx/ctl-rosmsgs"]
RATE = 100


@dataclasses.dataclass(frozen=True)
class Plan:
    seconds: int = 20       # of most measurements
    rounds: int = 10        # of the catalog and Cyclone DDS in turn
    values: int = 300       # in each round
    firsts: int = 20
    lossy: int = 600
    pause: float = 1.0


SHORT, SHORT_ROWS = Plan(1, 1, 20, 1, 5, 0), ["first", "mirror", "clock"]  # other tests cover the other rows


class Bench(Closing):
    """The machines and the measurements. `laptop`, `second` and `third` read what `robot` writes."""

    def __init__(self, folder: pathlib.Path, link: Link, plan: Plan) -> None:
        self.folder, self.link, self.plan = folder, link, plan
        self.robot = Machine(folder / "robot", "robot", link.robot, RULES)
        self.laptop = Machine(folder / "laptop", "laptop", link.operator[0], RULES)
        self.machines = [self.robot, self.laptop]
        self.nodes: list[subprocess.Popen[bytes]] = []  # of ROS

    def end(self) -> None:
        for node in self.nodes:
            kill(node)
        for machine in self.machines:
            machine.end()

    def written(self, item: str, rate: int = RATE) -> Client:
        """Start a writer on the robot, and wait until the laptop knows its item."""
        writer = self.robot.writer("write", "store", item, str(rate))
        writer.line()
        writer.ask(1)
        self.laptop.wait_for(f"robot:{item}")
        return writer

    def read(self, item: str, machine: Machine | None = None) -> Reader:
        reader = (machine or self.laptop).reader("read", "store", f"robot:{item}")
        wait_until(lambda: bool(reader.numbers()), f"no value of {item} arrives")
        return reader

    def unread(self) -> dict[str, Any]:
        """Packets and CPU time without a subscriber. Then a reader shows that data packets would have been noticed."""
        writer, sniffer = self.written("unread"), self.laptop.sniffer(MARK)
        count = self.plan.seconds * RATE
        percent = percent_while(self.robot.catalog, lambda: writer.ask(count))
        packets = sniffer.ask()
        self.read("unread")
        wait_until(lambda: self.robot.readers("unread") > 0, "the catalog does not read")
        writer.ask(10)
        if not sniffer.ask() - packets:
            raise Failed("packets with values are not recognized")
        return {"values": count, "data_packets": packets, "catalog_percent": percent}

    def first(self) -> dict[str, Any]:
        """Time from the request to the first value, for items of a known machine that were not read before."""
        names = [f"first{number}" for number in range(self.plan.firsts)]
        for name in names:
            self.written(name)
        asked = self.laptop.writer("first", "store", *(f"robot:{name}" for name in names))
        times = [float(asked.line()) for _ in names]
        return {"p50_ms": percentile(times, 50), "max_ms": max(times)}

    def mirror(self) -> dict[str, Any]:
        """Latency, in turn with Cyclone DDS over the same link."""
        writers = {"catalog": self.written("mirror")}
        readers = {"catalog": self.read("mirror"), "cyclonedds": self.laptop.reader("read", "dds", "rt/bare")}
        writers["cyclonedds"] = self.robot.writer("write", "dds", "rt/bare", str(RATE))
        writers["cyclonedds"].line()
        found: dict[str, list[list[float]]] = {name: [] for name in writers}
        for number in range(self.plan.rounds):
            for name in sorted(writers, reverse=bool(number % 2)):
                before = len(readers[name].numbers())
                writers[name].ask(self.plan.values)
                time.sleep(0.1)  # the last ones are on their way
                found[name].append([one / 1000 for one in readers[name].numbers()[before:]])
        flat = {name: [one for part in parts for one in part if one >= 0] for name, parts in found.items()}
        ratios = [percentile(ours, 50) / percentile(bare, 50) for ours, bare in zip(found["catalog"],
                                                                                    found["cyclonedds"])]
        return {**{f"{name}_p{part}_ms": percentile(values, part) for name, values in flat.items()
                   for part in (50, 99)}, "ratio": statistics.median(ratios),
                "missing": 2 * self.plan.rounds * self.plan.values - sum(map(len, flat.values()))}

    def memory(self) -> dict[str, Any]:
        """Memory while a mirror is read, and the size of the programs without symbols, as in an image."""
        writer = self.written("memory")
        self.read("memory")
        writer.ask(RATE)
        sizes = []
        for program in PROGRAMS:
            stripped = self.folder / pathlib.Path(program).name
            run(["strip", "-o", stripped, OUTPUT / "desk/root/usr" / program])
            sizes.append(int(run(["sh", "-c", 'xz -9 --stdout "$1" | wc -c', "sh", stripped])))
        return {"robot_mib": self.robot.private_mib(), "laptop_mib": self.laptop.private_mib(),
                "compressed_mib": sum(sizes) / (1 << 20)}

    def clock(self) -> dict[str, Any]:
        """Error of the clock estimate: all machines here share one clock, so the true offset is 0."""
        offsets, bounds = [], []
        wait_until(lambda: bool(self.laptop.others()), "the robot is not heard")
        for _ in range(self.plan.seconds):
            other = self.laptop.others()[0]
            offsets.append(abs(other["offset"]) / 1e6)
            bounds.append(other["bound"] / 1e6)
            time.sleep(self.plan.pause)
        return {"p50_ms": percentile(offsets, 50), "max_ms": max(offsets), "bound_ms": max(bounds)}

    def lossy(self) -> dict[str, Any]:
        """Lose 20 % of all packets in both directions. The first and the last value pass without loss."""
        writer = self.written("lossy", 10)
        reader = self.read("lossy")
        time.sleep(2)  # counters are written once a second
        before = self.robot.counters(), self.laptop.counters()
        self.link.lose(Iid(0.2))
        writer.ask(self.plan.lossy)
        self.link.lose(NOTHING)
        writer.ask(1)

        def change(number: int, what: str) -> int:
            machine = (self.robot, self.laptop)[number]
            now, then = machine.counters(), before[number]
            return (int(now["lost"][what]) - int(then["lost"][what]) if what == "network"
                    else int(now[what]) - int(then[what]))

        written = self.plan.lossy + 1
        wait_until(lambda: change(0, "in") == written and change(1, "in") >= change(0, "out"), "values are missing",
                   patience=30)
        return {"written": written, "sent": change(0, "out"), "arrived": change(1, "out"),
                "lost": change(1, "network"), "read": len([one for one in reader.numbers() if one >= 0]) - 1,
                "exact": change(1, "in") == change(0, "out") == change(1, "out") + change(1, "network")}

    def three(self) -> dict[str, Any]:
        """Network load with three known machines, when one or all three of them read."""
        writer = self.written("three")
        more = [Machine(self.folder / name, name, node, RULES)
                for name, node in zip(("second", "third"), self.link.operator[1:])]
        self.machines += more
        for machine in more:
            machine.wait_for("robot:three")
        counts, values, readers = [], self.plan.seconds * RATE, []
        for machines in ([self.laptop], more):
            readers += [self.read("three", machine) for machine in machines]
            time.sleep(self.plan.pause)
            before = self.robot.sent()
            writer.ask(values)
            counts.append((self.robot.sent() - before) / values)
        time.sleep(0.1)  # the last ones are on their way
        missing = sum(reader.numbers()[-values:].count(-1) for reader in readers)
        return {"one_bytes": counts[0], "three_bytes": counts[1], "ratio": counts[1] / counts[0], "missing": missing}

    def frames(self) -> dict[str, Any]:
        """CPU time for pictures to ROS, then that of Cyclone DDS in a process that has them ready in ROS's form."""
        others = peers.peers()
        count = self.plan.seconds * clip.RATE
        found: dict[str, Any] = {"frames": count}
        node = self.listen(others, "/image")
        self.robot.start("ddxvideoload", str(clip.write(self.folder / "clip.y4m", self.plan.seconds)), "-readers", "1")
        wait_until(lambda: self.lines(node) > 0, "ROS gets no picture", patience=60)
        found["catalog_percent"] = percent_while(self.robot.catalog, lambda: time.sleep(self.plan.seconds - 3))
        with_all = time.monotonic() + 10
        while self.lines(node) < count and time.monotonic() < with_all:
            time.sleep(0.1)
        found["catalog_arrived"] = self.lines(node)
        node = self.listen(others, "/bare")
        bare = self.robot.writer("frames", "dds", "rt/bare", str(clip.RATE))
        bare.line()
        time.sleep(2)  # ROS's reader has found it as well
        found["cyclonedds_percent"] = percent_while(bare.process, lambda: bare.ask(count))
        time.sleep(1)
        found["cyclonedds_arrived"] = self.lines(node)
        return found

    def listen(self, others: pathlib.Path, topic: str) -> pathlib.Path:
        """Start a ROS 2 node on the second operator; the result is a file with a line for each message."""
        path = self.folder / topic.strip("/")
        environment = {**os.environ, "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp", "ROS_LOG_DIR": str(self.folder),
                       "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"}
        command = [*self.link.operator[1].inside, str(others / "bin/python"), str(TOP / "tests/host/ros_peer.py"),
                   "listen", topic, "sensor_msgs/msg/Image"]
        with path.open("w") as file:
            self.nodes.append(subprocess.Popen([*MORTAL, *command], env=environment, stdout=file))
        return path

    @staticmethod
    def lines(path: pathlib.Path) -> int:
        return path.read_text().count("\n")


ROWS: dict[str, tuple[Callable[[Bench], dict[str, Any]], str, Callable[[dict[str, Any]], bool]]] = {
    "unread": (Bench.unread, "no data packet; 0.5 % of a core",
               lambda found: bool(not found["data_packets"] and found["catalog_percent"] <= 0.5)),
    "first": (Bench.first, "200 ms", lambda found: bool(found["max_ms"] <= 200)),
    "mirror": (Bench.mirror, "p50 1 ms, p99 5 ms, 1.3 of Cyclone DDS",
               lambda found: bool(found["catalog_p50_ms"] <= 1 and found["catalog_p99_ms"] <= 5
                                  and found["ratio"] <= 1.3)),
    "memory": (Bench.memory, "6 MiB; 0.6 MiB",
               lambda found: bool(max(found["robot_mib"], found["laptop_mib"]) <= 6
                                  and found["compressed_mib"] <= 0.6)),
    "clock": (Bench.clock, "0.5 ms", lambda found: bool(found["max_ms"] <= 0.5)),
    "lossy": (Bench.lossy, "99 %, the rest counted",
              lambda found: bool(found["exact"] and found["arrived"] >= 0.99 * found["written"])),
    "frames": (Bench.frames, "all; 3 % of a core",
               lambda found: bool(found["catalog_arrived"] == found["frames"] and found["catalog_percent"] <= 3)),
    "three": (Bench.three, "1.1", lambda found: bool(found["ratio"] <= 1.1)),
}


def measure(rows: list[str], plan: Plan) -> Iterator[dict[str, Any]]:
    with (scratch() as folder, Link(operators=3) as link,
          Bench(folder, link, plan) as bench):
        for row in rows:
            action, goal, reached = ROWS[row]
            found = {what: round(value, 3) if isinstance(value, float) else value
                     for what, value in action(bench).items()}
            yield {"row": row, "goal": goal, "reached": reached(found), **found}


def main() -> int:
    options = command_line(__doc__, rows="", short=False)
    native.build()
    wanted = SHORT_ROWS if options.short else [row for row in ROWS
                                              if any(word in row for word in options.rows.split(","))]
    load, rows = os.getloadavg()[0], []
    for found in measure(wanted, SHORT if options.short else Plan()):
        figures = ", ".join(f"{what} {value}" for what, value in found.items()
                            if what not in ("row", "goal", "reached"))
        missed = "" if found["reached"] or options.short else "MISSED "
        say(f"{found['row']:8}{missed}{figures} (goal: {found['goal']})")
        rows.append(found)
    if not options.short:
        save("catalog", {"load": load, "rows": rows})
    return 0


if __name__ == "__main__":
    finish("bench", main)
