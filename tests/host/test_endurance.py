# SPDX-License-Identifier: GPL-2.0-or-later
"""Nothing grows while services are switched thousands of times, or while video flows, on the host's kernel. Also tests
the verdict: a leak is reported, normal variation is not."""
import pathlib
import subprocess
from collections.abc import Callable

import pytest

import endurance
from parts.guest.robot import Robot

pytestmark = pytest.mark.retry

FEW = 40
LOOKS = 2  # samples; the first and the last are judged, each once the logger has released old requests
FIRST = {"available": 200_000, "descriptors": 300, "processes": 90, "files": 400,
         **{name: 1000 for name in endurance.RECORDING}}


def grown(**by: int) -> list[str]:
    return endurance.growth([FIRST, {name: value + by.get(name, 0) for name, value in FIRST.items()}])


def test_steady_values_are_not_growth() -> None:
    assert grown() == []
    assert grown(available=-endurance.MEMORY_LIMIT, ddxstore=200, processes=-2, descriptors=-5, files=60) == []


@pytest.mark.parametrize("name, by", [
    ("descriptors", 9), ("processes", 3), ("available", -endurance.MEMORY_LIMIT - 1), ("ddxstore", 300),
    ("ddxvideosave", 300), ("files", 70)])
def test_growth_is_reported(name: str, by: int) -> None:
    assert len(grown(**{name: by})) == 1


def test_a_short_lived_process_is_not_growth() -> None:
    looks = [dict(FIRST) for _ in range(20)]
    looks[-1]["processes"] += 9
    assert endurance.growth(looks) == []
    for number, one in enumerate(looks):
        one["descriptors"] += number
    assert len(endurance.growth(looks)) == 1


class Printed(Robot):
    """A robot on which a command's input is this text instead of what `ls` prints."""

    def __init__(self, text: str) -> None:
        self.text = text

    def run(self, command: str, timeout: float = 0) -> tuple[int, str]:
        done = subprocess.run(["sh", "-c", command[command.index("|") + 1:]], input=self.text, capture_output=True,
                              text=True)
        return done.returncode, done.stdout


def memory(process: int, *slots: int, epoch: int = 1) -> str:
    return f"/proc/{process}/fd:\ntotal 0\n" + "".join(
        f"lr-x------ 1 root root 64 Nov 1 00:00 {slot} -> /memfd:video {epoch} 0123 frame {slot} (deleted)\n"
        for slot in slots)


@pytest.mark.parametrize("more, count, two", [
    (memory(7, *range(18, 34)), 1, 0), (memory(7, 3), 2, 0), (memory(8, *range(18)), 2, 0),
    (memory(7, 1, epoch=2), 1, 1), (memory(7).replace("total 0", "l 1 root 90 -> /memfd:video pin (deleted)"), 2, 0)],
    ids=["more slots", "a slot again", "another process", "a former epoch", "another file"])
def test_descriptors_are_counted(more: str, count: int, two: int) -> None:
    """More slots of the same epoch are no growth; a second descriptor of one, and a former epoch, are."""
    assert endurance.files(Printed(memory(7, *range(18)) + more)) == (count, two)


def test_nothing_grows(root: pathlib.Path) -> None:
    """Growth counts only if it repeats: requests to the store come and go."""
    if endurance.growth(endurance.natively(root, "toggles", FEW, LOOKS)):
        assert endurance.growth(endurance.natively(root, "toggles", FEW, LOOKS)) == []


# The logger touches the memory of its queue for the first time during eight minutes, which must be the beginning.
@pytest.mark.long
@pytest.mark.parametrize("kind, amount", [("toggles", endurance.ROUND), ("video", 40)])
def test_nothing_grows_over_hours(root: pathlib.Path, record_property: Callable[[str, object], None], kind: str,
                                 amount: int) -> None:
    looks = endurance.natively(root, kind, amount)
    record_property("first", looks[0])
    record_property("last", looks[-1])
    assert endurance.growth(looks) == []
