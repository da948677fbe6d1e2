# SPDX-License-Identifier: GPL-2.0-or-later
"""The expected contents of log_client's logs, read with PyPI's mcap (tests/lib/logs.py)."""
from __future__ import annotations

import pathlib
import struct
from typing import Any

from lib import logs

from .programs import Compiler, Desk, Process, wait_until

CONFIG = "output log\nexcept *.stats\nitem *\n"
Written = list[tuple[int, int]]  # number and CLOCK_MONOTONIC of each value


def begin(desk: Desk, config: str = CONFIG, instance: str = "ddxlog", wrapper: tuple[str, ...] = ()) -> Process:
    """Start a logger, and wait until it has looked at the store once."""
    (desk.folder / f"{instance}.conf").write_text(config)
    logger = desk.start("ddxlog", "-c", f"{instance}.conf", "-instance", instance, wrapper=wrapper)
    wait_until(lambda: f"{instance}.stats" in desk.run("ddxctl", "list").stdout)
    return logger


def write(desk: Desk, compile_client: Compiler, name: str, count: int, step_us: int, layout: str = "sample",
          first: int = 1, readers: int = 1) -> Process:
    return desk.start(compile_client("log_client"), name, first, count, step_us, readers, layout)


def written(desk: Desk, writer: Process) -> Written:
    out, _ = writer.communicate(timeout=60)
    assert writer.returncode == 0, desk.errors(writer)
    return [(int(number), int(time)) for number, time in (line.split() for line in out.splitlines())]


def files(desk: Desk, folder: str = "log") -> list[pathlib.Path]:
    return sorted((desk.folder / folder).glob("*.mcap"))


def only(desk: Desk, folder: str = "log") -> pathlib.Path:
    found = files(desk, folder)
    assert len(found) == 1, found
    return found[0]


def _float(number: float) -> float:
    return float(struct.unpack("f", struct.pack("f", number))[0])


def _wrapped(number: int, bits: int) -> int:
    return (number + (1 << bits - 1)) % (1 << bits) - (1 << bits - 1)


def check_sample(value: Any, number: int) -> None:
    """Check every field against its calculated value."""
    assert value.number == number and value.flag == number % 256 and value.last == number * 3 % 65536
    assert abs(value.ratio - _float(number / 3)) <= abs(number) * 1e-7
    assert bytes(value.text).rstrip(b"\0") == f"n{number % 1000000}".encode()
    assert value.gears_left == [number + i / 4 for i in range(4)]
    for i, part in enumerate(value.part):
        assert part.small == _wrapped(number + i, 8) and part.wide == number / 7 + i
        for k, corner in enumerate(part.corner):
            assert (corner.x, corner.y) == (_wrapped(number * 2 + i + k, 16), _wrapped(-number - i - k, 16))


def check_log(log: logs.Log, topic: str, expected: Written, first_sequence: int = 1) -> None:
    """Check that every value is there once, in order, with its fields, its number and the time of its write."""
    values = log.values.get(topic, [])
    assert [one.value.number for one in values] == [number for number, _ in expected]
    assert log.sequences(topic) == list(range(first_sequence, first_sequence + len(expected)))
    assert log.monotonic(topic) == [time for _, time in expected]
    assert all(one.log_time == one.publish_time for one in values)
    for one, (number, _) in zip(values, expected):
        if hasattr(one.value, "part"):
            check_sample(one.value, number)


def losses(log: logs.Log, item: str) -> dict[str, Any]:
    """An item's losses as recorded at the end of the file."""
    return dict([one.value for one in log.values["ddxlog/lost"] if one.value["item"] == item][-1])
