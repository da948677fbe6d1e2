# SPDX-License-Identifier: GPL-2.0-or-later
"""ddxhealth feeds the watchdog only while store and recorder are alive. Here killing them does not help, since
nothing supervises them; the reset of the machine is tested in tests/boot/test_health.py."""
from __future__ import annotations

import os
import pathlib
import signal
import subprocess
from collections.abc import Iterator

import pytest

from .programs import Desk, Process, send_signal, wait_until

NO_FOOD = "the watchdog gets no food"
WELL = "all is well again"
GIVEN_UP = "and it cannot be killed"  # logged every five seconds, checked every second


class Kennel:
    """ddxhealth, with a watchdog that counts, and what it takes for the folder of supervised services."""

    def __init__(self, desk: Desk, services: dict[str, Process]) -> None:
        source = pathlib.Path(__file__).with_name("watchdog.c")
        subprocess.run(["gcc", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC", source, "-o",
                        desk.folder / "watchdog.so"], check=True)
        for name, process in services.items():
            supervise = desk.folder / "service" / name / "supervise"
            supervise.mkdir(parents=True)
            (supervise / "pid").write_text(f"{process.pid}\n")
            os.mkfifo(supervise / "control")  # without reader
        self.desk = desk
        self.food = desk.folder / "food"
        (desk.folder / "watchdog").touch()
        wrapper = ("env", f"LD_PRELOAD={desk.folder}/watchdog.so", f"FOOD={self.food}")
        self.health = desk.start("ddxhealth", "-services", "service", "-watchdog", "watchdog", "-silence", "3",
                                 wrapper=wrapper)
        self.fed(3)

    def count(self) -> int:
        return self.food.stat().st_size if self.food.exists() else 0

    def fed(self, times: int) -> None:
        """From now on."""
        before = self.count()
        wait_until(lambda: self.count() >= before + times)

    def said(self, words: str) -> int:
        return self.desk.errors(self.health).count(words)

    def looks_on(self, words: str) -> None:
        """It has said these words once more."""
        before = self.said(words)
        wait_until(lambda: self.said(words) > before)


@pytest.fixture
def recorder(desk: Desk) -> Process:
    return desk.start("ddxvideosave", "-output", "clip.y4m")


@pytest.fixture
def kennel(desk: Desk, recorder: Process) -> Iterator[Kennel]:
    sender = desk.start("ddxvideosend", "-interface", "lo")
    yield Kennel(desk, {"store": desk.store, "ddxvideosave": recorder, "ddxvideosend": sender})


@pytest.mark.parametrize("name", ["store", "ddxvideosave"])
def test_no_food_while_one_of_the_two_hangs(desk: Desk, kennel: Kennel, recorder: Process, name: str) -> None:
    hung = {"store": desk.store, "ddxvideosave": recorder}[name]
    send_signal(hung, signal.SIGSTOP)
    wait_until(lambda: kennel.said(NO_FOOD) == 1)
    wait_until(lambda: kennel.said(GIVEN_UP) > 0)
    before = kennel.count()
    kennel.looks_on(GIVEN_UP)
    assert kennel.count() == before
    assert kennel.said(NO_FOOD) == 1 and kennel.said(WELL) == 0
    send_signal(hung, signal.SIGCONT)
    wait_until(lambda: kennel.said(WELL) == 1)
    kennel.fed(3)


def test_the_others_are_no_reason_for_a_reset(desk: Desk, kennel: Kennel) -> None:
    desk.processes[2].send_signal(signal.SIGSTOP)
    wait_until(lambda: kennel.said(GIVEN_UP) > 0)
    kennel.fed(3)
    assert kennel.said(NO_FOOD) == 0


def test_a_recorder_that_was_switched_off_is_not_waited_for(desk: Desk, kennel: Kennel, recorder: Process) -> None:
    (desk.folder / "service/ddxvideosave/down").touch()
    recorder.send_signal(signal.SIGSTOP)
    kennel.fed(6)
    assert kennel.said(NO_FOOD) == kennel.said(GIVEN_UP) == 0
