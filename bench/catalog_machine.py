# SPDX-License-Identifier: GPL-2.0-or-later
"""The catalog's benchmark: a machine with a store and a catalog, and its writers and readers."""
import json
import pathlib
import re
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

from bench.programs import Programs, cpu_seconds
from parts.common import MORTAL, OUTPUT, TOP, Command, output, wait_until
from parts.link.link import Node
from parts.processes import Client, kill

BENCH = OUTPUT / "desk/ddxcatalog/tests/bench"


class Reader:
    """A program that prints a number for each value, -1 for each missed value."""

    def __init__(self, command: Command, path: pathlib.Path, environment: dict[str, str]) -> None:
        self.path = path
        with path.open("w") as file:
            self.process = subprocess.Popen(command, stdout=file, env=environment)

    def numbers(self) -> list[float]:
        """The numbers so far, in microseconds."""
        return [float(line) for line in self.path.read_text().split("\n")[:-1]]

    def end(self) -> None:
        kill(self.process)


class Machine(Programs):
    def __init__(self, folder: pathlib.Path, name: str, node: Node, rules: str = "") -> None:
        folder.mkdir()
        (folder / "exports.conf").write_text(rules)
        super().__init__(folder, node.inside)
        self.name, self.node = name, node
        self.catalog = self.start("ddxcatalog", "-machine", name, "-c", "exports.conf")
        self.clients: list[Client | Reader] = []

    def ctl(self, *words: str) -> str:
        return output([self.bin / "ddxctl", *words], self.environment)

    def others(self) -> list[dict[str, Any]]:
        """The known machines and their clocks."""
        shown = self.ctl("show", "catalog.machines", "--json")
        return list(json.loads(shown)["value"]["machine"]) if shown else []

    def wait_for(self, item: str) -> None:
        """Wait until this item of another machine is known here."""
        wait_until(lambda: f'"{item}"' in self.ctl("catalog", "--json"), f"{item} is not heard")

    def counters(self) -> dict[str, Any]:
        return dict(self._counters("ddxcatalog")[0])

    def readers(self, item: str) -> int:
        shown = self.ctl("list", "--json")
        found = json.loads(shown)["items"] if shown else []
        return next((int(one["readers"]) for one in found if one["name"] == item), 0)

    def writer(self, *words: str) -> Client:
        client = Client([*MORTAL, *self.inside, BENCH, *words], env=self.environment)
        self.clients.append(client)
        return client

    def reader(self, *words: str) -> Reader:
        reader = Reader([*MORTAL, *self.inside, BENCH, *words], self.folder / f"reader-{len(self.clients)}",
                        self.environment)
        self.clients.append(reader)
        return reader

    def sniffer(self, mark: bytes) -> Client:
        command = [*MORTAL, *self.inside, sys.executable, "-B", "-m", "bench.sniff", mark.hex()]
        client = Client(command, cwd=TOP)
        self.clients.append(client)
        client.line()
        return client

    def sent(self) -> int:
        """Bytes that this machine has sent, headers included."""
        text = self.node.run(["cat", "/proc/net/dev"], stdout=subprocess.PIPE).stdout
        return sum(int(line.split(":")[1].split()[8]) for line in text.splitlines()[2:]
                   if line.split(":")[0].strip() != "lo")

    def private_mib(self) -> float:
        """The catalog's private memory."""
        text = pathlib.Path(f"/proc/{self.catalog.pid}/smaps_rollup").read_text()
        return sum(map(int, re.findall(r"^Private_\w+: +(\d+) kB", text, re.M))) / 1024

    def end(self) -> None:
        for client in self.clients:
            client.end()
        self.catalog.kill()
        super().end()


def percent_while(process: subprocess.Popen[Any], action: Callable[[], object]) -> float:
    """Percent of a core that the process uses while the action runs."""
    before, begin = cpu_seconds(process), time.monotonic()
    action()
    return 100 * (cpu_seconds(process) - before) / (time.monotonic() - begin)
