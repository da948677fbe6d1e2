# SPDX-License-Identifier: GPL-2.0-or-later
"""ddxhealth feeds the watchdog only while store and recorder are alive, and reports the first frame. Killing programs
does not help here, since nothing supervises them; the reset is tested in tests/boot/test_health.py."""
from __future__ import annotations

import os
import pathlib
import signal
import subprocess
from collections.abc import Iterator

import pytest

from .programs import Desk, Process, make_clip, send_signal, wait_until

pytestmark = pytest.mark.retry

NOT_FED = "the watchdog is not fed"
WELL = "all is well again"
GIVEN_UP = "and it cannot be killed"  # logged every five seconds, checked every second


class Health:
    """ddxhealth with a watchdog that counts, and a simulated folder of supervised services."""

    def __init__(self, desk: Desk, services: dict[str, Process]) -> None:
        source = pathlib.Path(__file__).with_name("watchdog.c")
        subprocess.run(["gcc", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC", source, "-o",
                        desk.folder / "watchdog.so"], check=True)
        for name, process in services.items():
            supervise = desk.folder / "service" / name / "supervise"
            supervise.mkdir(parents=True)
            (supervise / "pid").write_text(f"{process.pid}\n")
            os.mkfifo(supervise / "control")  # without a reader
        self.desk = desk
        self.food = desk.folder / "food"
        (desk.folder / "watchdog").touch()
        self.late = desk.folder / "late"
        os.mkfifo(self.late)
        wrapper = ("env", f"LD_PRELOAD={desk.folder}/watchdog.so", f"FOOD={self.food}")
        self.health = desk.start("ddxhealth", "-services", "service", "-watchdog", "watchdog", "-silence", "3",
                                 "-late", self.late, wrapper=wrapper)
        self.wait_until_fed(3)

    def count(self) -> int:
        return self.food.stat().st_size if self.food.exists() else 0

    def wait_until_fed(self, times: int) -> None:
        """Wait for that many feedings from now on."""
        before = self.count()
        wait_until(lambda: self.count() >= before + times)

    def lines(self, words: str) -> int:
        return self.desk.errors(self.health).count(words)

    def wait_for_line(self, words: str) -> None:
        """Wait until it prints these words once more."""
        before = self.lines(words)
        wait_until(lambda: self.lines(words) > before)


@pytest.fixture
def recorder(desk: Desk) -> Process:
    return desk.start("ddxvideosave", "-output", "clip.y4m")


@pytest.fixture
def health(desk: Desk, recorder: Process) -> Iterator[Health]:
    sender = desk.start("ddxvideosend", "-interface", "lo")
    yield Health(desk, {"ddxstore": desk.store, "ddxvideosave": recorder, "ddxvideosend": sender})


@pytest.mark.parametrize("name", ["ddxstore", "ddxvideosave"])
def test_no_feeding_while_store_or_recorder_hangs(desk: Desk, health: Health, recorder: Process, name: str) -> None:
    hung = {"ddxstore": desk.store, "ddxvideosave": recorder}[name]
    send_signal(hung, signal.SIGSTOP)
    wait_until(lambda: health.lines(NOT_FED) == 1)
    wait_until(lambda: health.lines(GIVEN_UP) > 0)
    before = health.count()
    health.wait_for_line(GIVEN_UP)
    assert health.count() == before
    assert health.lines(NOT_FED) == 1 and health.lines(WELL) == 0
    send_signal(hung, signal.SIGCONT)
    wait_until(lambda: health.lines(WELL) == 1)
    health.wait_until_fed(3)


def test_other_programs_that_hang_cause_no_reset(desk: Desk, health: Health) -> None:
    desk.processes[2].send_signal(signal.SIGSTOP)
    wait_until(lambda: health.lines(GIVEN_UP) > 0)
    health.wait_until_fed(3)
    assert health.lines(NOT_FED) == 0


def test_a_recorder_that_was_switched_off_is_ignored(desk: Desk, health: Health, recorder: Process) -> None:
    (desk.folder / "service/ddxvideosave/down").touch()
    recorder.send_signal(signal.SIGSTOP)
    health.wait_until_fed(6)
    assert health.lines(NOT_FED) == health.lines(GIVEN_UP) == 0


def test_the_first_frame_is_reported(desk: Desk, health: Health) -> None:
    """The recorder and the sender have counters, but no frames."""
    reader = os.open(health.late, os.O_RDONLY | os.O_NONBLOCK)

    def heard() -> bytes:
        try:
            return os.read(reader, 1)
        except BlockingIOError:  # it is just being written
            return b""
    health.wait_until_fed(3)
    assert heard() == b""
    desk.run("ddxvideoload", make_clip(desk.folder / "clip.y4m", frames=3))
    wait_until(lambda: heard() == b"\n")
    os.close(reader)
