#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""make rollout: a new version onto many robots, by ssh: docs/update.md

rollout.py UPDATE ROBOTS    an update file, and a file with the name of a robot in each line

Each step begins with what the robot reports (`ddxctl update status --json`), so that a later call continues.
"""
from __future__ import annotations

import concurrent.futures
import dataclasses
import json
import pathlib
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from typing import Any

from parts.common import OUTPUT, BadInput, Failed, finish, say
from parts.release import update_file
from parts.release.update_file import Release
from parts.testing.campaign import Campaign

AT_A_TIME = 10
GROUPS = (1, 5)  # robots of the first groups; the last one has the others
LOOK = 5.0       # s; between two looks at a robot on trial
PATIENCE = 3600.0  # s; for a group: a trial takes six minutes, one that fails takes 20, a check of a large disk an hour
LOST = 255       # ssh's own exit status: no connection
SSH = ("ssh", "-o", "BatchMode=yes", "-o", "ConnectTimeout=15", "-o", "ServerAliveInterval=10", "-o",
       "ServerAliveCountMax=3")


@dataclasses.dataclass(frozen=True)
class Status:
    """The report of `ddxctl update status --json`."""
    running: str
    chosen: str
    last: str
    reason: str
    slots: dict[str, Any]

    def has(self, slot: str, what: Release) -> bool:
        found = self.slots.get(slot) or {}
        return (found.get("version"), str(found.get("serial"))) == (what.version, what.serial)

    def runs(self, what: Release) -> bool:
        return self.has(self.running, what)

    def kept(self, what: Release) -> bool:
        """A version that is taken back runs until the restart, but is not the chosen one. A robot that was flashed
        with this version needs no trial."""
        return self.runs(what) and self.chosen == self.running and self.last not in ("trial", "chosen")

    def restarts(self, what: Release) -> bool:
        """It will start this version next."""
        return self.chosen != self.running and self.has(self.chosen, what)

    def written(self, what: Release) -> bool:
        return any(self.has(slot, what) for slot in self.slots if slot != self.running)


@dataclasses.dataclass(frozen=True)
class Robot:
    name: str

    def ssh(self, command: str, file: pathlib.Path | None = None) -> subprocess.CompletedProcess[str]:
        target = self.name if "@" in self.name else f"root@{self.name}"
        with (file or pathlib.Path("/dev/null")).open("rb") as source:
            return subprocess.run([*SSH, target, command], stdin=source, capture_output=True, text=True,
                                  errors="replace", check=False)

    def failed(self, done: subprocess.CompletedProcess[str]) -> Failed:
        lines = done.stderr.strip().splitlines() or [f"exit status {done.returncode}"]
        what_next = "; call again, or take it off the list" if done.returncode == LOST else ""
        return Failed(f"{self.name}: {lines[-1].strip()}{what_next}")

    def look(self) -> Status:
        done = self.ssh("ddxctl update status --json")
        if done.returncode:
            raise self.failed(done)
        try:
            words = json.loads(done.stdout)
            return Status(**{field.name: words[field.name] for field in dataclasses.fields(Status)})
        except (ValueError, KeyError, TypeError):
            raise Failed(f"{self.name}: `ddxctl update status --json` is not understood: {done.stdout[:200]}") from None


def read_robots(file: pathlib.Path) -> list[Robot]:
    """A name or user@name in each line; empty lines and comments are left out."""
    if not file.is_file():
        raise BadInput(f"there is no file {file}; ROBOTS=file, with the name of a robot in each line")
    names = [name for line in file.read_text().splitlines() if (name := line.partition("#")[0].strip())]
    for name in names:
        if name.startswith("-") or len(name.split()) > 1:
            raise BadInput(f"{file}: '{name}' is no name of a robot")
        if names.count(name) > 1:
            raise BadInput(f"{file}: {name} is there twice")
    if not names:
        raise BadInput(f"{file}: names no robot")
    return [Robot(name) for name in names]


class Rollout:
    def __init__(self, update: pathlib.Path, robots: list[Robot], folder: pathlib.Path = OUTPUT / "rollout",
                 pause: float = LOOK) -> None:
        self.update, self.robots, self.pause = update, robots, pause
        self.what = update_file.read(update)
        self.campaign = Campaign(folder / f"{update.stem}.jsonl", [update])

    def all(self, robots: Iterable[Robot], action: Callable[[Robot], object]) -> None:
        """Ten at a time. All are tried; then the failures, if any, are raised as one."""
        failures: list[str] = []

        def act(robot: Robot) -> None:
            try:
                action(robot)
            except Failed as error:
                failures.append(str(error))
                say(f"rollout: {error}")

        with concurrent.futures.ThreadPoolExecutor(AT_A_TIME) as pool:
            list(pool.map(act, robots))
        if failures:
            raise Failed(f"{failures[0]}" + (f"; and {len(failures) - 1} more, see above" if failures[1:] else ""))

    def write(self, robot: Robot) -> None:
        """Unless the robot has this version already: its other slot has the version before."""
        status = robot.look()
        written = f"write {robot.name}"
        if status.runs(self.what) or status.restarts(self.what):
            return
        # A robot's version is compared with the file's hashes before `ddxctl update -` returns, not by `status`.
        if self.campaign.results.get(written) and status.written(self.what):
            return
        done = robot.ssh("ddxctl update -", self.update)
        if done.returncode:
            raise robot.failed(done)
        self.campaign.add(written, True)
        say(f"rollout: {robot.name}: version {self.what.version} is written")

    def start(self, robot: Robot) -> None:
        """Unless it has been started, by an earlier call, too."""
        status = robot.look()
        if status.runs(self.what) or status.restarts(self.what):
            return
        done = robot.ssh("ddxctl update start")
        # The restart may cut the connection after the answer.
        if done.returncode not in (0, LOST) or (done.returncode == LOST and "is started next" not in done.stdout):
            raise robot.failed(done)
        say(f"rollout: {robot.name}: restarts")

    def ended(self, robot: Robot) -> bool:
        """Whether the robot has kept the version; fails if it has taken it back."""
        try:
            status = robot.look()
        except Failed:  # between two starts
            return False
        if status.restarts(self.what):
            return False
        if not status.runs(self.what):
            raise Failed(f"{robot.name}: has taken version {self.what.version} back: "
                         f"{status.reason or 'the reason is not known'}")
        if status.kept(self.what):
            say(f"rollout: {robot.name}: kept")
            return True
        return False

    def wait(self, robots: list[Robot]) -> None:
        waiting, end = list(robots), time.monotonic() + PATIENCE
        while waiting:
            kept: dict[str, bool] = {}
            self.all(waiting, lambda robot: kept.update({robot.name: self.ended(robot)}))
            waiting = [robot for robot in waiting if not kept[robot.name]]
            if waiting and time.monotonic() > end:
                raise Failed(f"no end of the trial of {' '.join(robot.name for robot in waiting)}; call again")
            if waiting:
                time.sleep(self.pause)

    def run(self) -> None:
        say(f"rollout: version {self.what.version}, serial {self.what.serial}, onto {len(self.robots)} robots")
        self.all(self.robots, self.write)
        at = 0
        for size in (*GROUPS, len(self.robots)):
            group = self.robots[at:at + size]
            at += size
            if group:
                self.all(group, self.start)
                self.wait(group)
        say(f"rollout: {len(self.robots)} robots have kept version {self.what.version}")


def main() -> int:
    match sys.argv[1:]:
        case [update, robots] if update and robots:
            Rollout(pathlib.Path(update).expanduser(), read_robots(pathlib.Path(robots).expanduser())).run()
        case [_, _]:
            raise BadInput("of what, and where? UPDATE=file.update ROBOTS=file, with the name of a robot in each line")
        case _:
            print(__doc__, file=sys.stderr)
            return 2
    return 0


if __name__ == "__main__":
    finish("rollout", main)
