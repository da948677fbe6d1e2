# SPDX-License-Identifier: GPL-2.0-or-later
"""Values of nested types from a shell: ddxctl show and ddxctl set."""
from __future__ import annotations

import json
import pathlib
from typing import Any

import pytest

from .programs import Compiler, Desk, wait_until

pytestmark = pytest.mark.retry


@pytest.fixture
def sensor(desk: Desk, compile_client: Compiler) -> Desk:
    """A store with the item `sensor`, whose writer has exited."""
    done = desk.run(compile_client("sensor_client"))
    assert done.returncode == 0, done.stderr
    return desk


def shown(desk: Desk, item: str = "sensor") -> dict[str, Any]:
    return dict(json.loads(desk.run("ddxctl", "show", item, "--json").stdout))


def refused(desk: Desk, *changes: str) -> str:
    """Check that `ddxctl set` reports bad usage in one line and writes nothing; return the message."""
    before = shown(desk)
    done = desk.run("ddxctl", "set", "sensor", *changes)
    assert done.returncode == 2 and done.stdout == ""
    assert done.stderr.startswith("ddxctl: sensor: ") and done.stderr.count("\n") == 1
    assert shown(desk) == before
    return done.stderr.removeprefix("ddxctl: sensor: ").rstrip("\n")


def test_show_names_every_field(sensor: Desk) -> None:
    lines = dict(line.split(maxsplit=1) for line in sensor.run("ddxctl", "show", "sensor").stdout.splitlines()[1:])
    assert lines["name"] == '"front"'
    assert lines["imu.accel[1].y"] == "9.75" and lines["imu.accel[0].y"] == "0"
    assert lines["imu.bias"] == "[0.5, 0.25, 0.125]"
    assert lines["imu.temperature"] == "-40"
    assert lines["wheel[1].gears"] == "[0, 1, 2, 3, 4, 5]"
    assert lines["serial"] == str(2**64 - 1)
    assert lines["beam"].endswith("15, ... 40 in all]")


def test_show_as_json(sensor: Desk) -> None:
    value = shown(sensor)["value"]
    assert value["name"] == "front"
    assert value["imu"]["accel"] == [{"x": 0, "y": 0, "z": 0}, {"x": 0, "y": 9.75, "z": 0}]
    assert [wheel["gears"] for wheel in value["wheel"]] == [[0] * 6, [0, 1, 2, 3, 4, 5], [0] * 6]
    assert value["beam"] == list(range(40))


def test_set_changes_only_what_it_names(sensor: Desk) -> None:
    before = shown(sensor)
    done = sensor.run("ddxctl", "set", "sensor", "imu.accel[0].z=-1.5", "name=rear", "imu.temperature=127",
                      "wheel[2].gears[5]=-32768", "wheel[0].gears=1,2,3,4,5,6", "serial=0x10", "imu.bias=1,2e-3,-4")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    after = shown(sensor)
    assert after["sequence"] == before["sequence"] + 1 and after["time_ns"] > before["time_ns"]
    value = before["value"]
    value["imu"]["accel"][0]["z"] = -1.5
    value["imu"] |= {"temperature": 127, "bias": [1, 2e-3, -4]}
    value["name"] = "rear"
    value["wheel"][2]["gears"][5] = -32768
    value["wheel"][0]["gears"] = [1, 2, 3, 4, 5, 6]
    value["serial"] = 16
    assert after["value"] == value


@pytest.mark.parametrize("change, text", [
    ("nothing=1", "nothing: no such field; there are name, imu, wheel, serial, beam"),
    ("imu.nothing=1", "imu.nothing: no such field; there are name, imu, wheel, serial, beam"),
    ("serial.x=1", "serial.x: no such field; there are name, imu, wheel, serial, beam"),
    ("imu=1", "imu: a struct; name a field in it"),
    ("wheel.id=1", "wheel: an array of structs: wheel[0]..."),
    ("wheel[3].id=1", "wheel: its elements are 0 to 2"),
    ("wheel[-1].id=1", "wheel: an index is a number in brackets"),
    ("wheel[1.id=1", "wheel: an index is a number in brackets"),
    ("serial[1]=1", "serial: its elements are 0 to 0"),
    ("wheel[0].id=256", "wheel[0].id: takes a whole number from 0 to 255, not 256"),
    ("wheel[0].id=-1", "wheel[0].id: takes a whole number from 0 to 255, not -1"),
    ("imu.temperature=128", "imu.temperature: takes a whole number from -128 to 127, not 128"),
    ("imu.temperature=-129", "imu.temperature: takes a whole number from -128 to 127, not -129"),
    ("serial=18446744073709551616", "serial: takes a whole number from 0 to 18446744073709551615, not "
                                    "18446744073709551616"),
    ("serial=1.5", "serial: takes a whole number from 0 to 18446744073709551615, not 1.5"),
    ("serial=", "serial: takes a whole number from 0 to 18446744073709551615, not "),
    ("imu.accel[0].x=1e39", "imu.accel[0].x: takes a number from -3.40282e+38 to 3.40282e+38, not 1e39"),
    ("imu.accel[0].x=nan", "imu.accel[0].x: takes a number from -3.40282e+38 to 3.40282e+38, not nan"),
    ("imu.bias=1,2", "imu.bias: takes 3 numbers, or name one of them: imu.bias[0]"),
    ("imu.bias=1,2,3,4", "imu.bias: takes 3 numbers, or name one of them: imu.bias[0]"),
    ("imu.bias=1,,3", "imu.bias: takes a number from -1.79769e+308 to 1.79769e+308, not ,3"),
    ("name=twelve bytes", "name: takes a text of 0 to 11 bytes, not 12"),
    ("name", "name: not field=value"),
])
def test_set_refuses(sensor: Desk, change: str, text: str) -> None:
    assert refused(sensor, "imu.temperature=1", change) == text


def test_set_does_not_replace_a_running_writer(desk: Desk, compile_client: Compiler) -> None:
    writer = desk.start(compile_client("sensor_client"), "hold")
    wait_until(lambda: desk.run("ddxctl", "show", "sensor").returncode == 0)
    done = desk.run("ddxctl", "set", "sensor", "name=rear")
    assert done.returncode == 1
    assert done.stderr == f"ddxctl: sensor: not set, process {writer.pid} writes it; stop it first\n"
    assert shown(desk)["value"]["name"] == "front"
    writer.kill()
    writer.wait()
    assert desk.run("ddxctl", "set", "sensor", "name=rear").returncode == 0
    assert shown(desk)["value"]["name"] == "rear"


@pytest.mark.parametrize("arguments, status, text", [
    (["nothing", "a=1"], 1, "ddxctl: nothing: the store has no item of this name"),
    (["sensor"], 2, "ddxctl: set: needs field=value"),
    ([], 2, "ddxctl: set: needs the name of an item"),
])
def test_set_needs_an_item_and_changes(sensor: Desk, arguments: list[str], status: int, text: str) -> None:
    done = sensor.run("ddxctl", "set", *arguments)
    assert done.returncode == status and done.stderr.startswith(text)


def test_a_reader_sees_whole_values_only(sensor: Desk, tmp_path: pathlib.Path) -> None:
    """A watcher sees each `set` as one write, without a missed one."""
    watcher = sensor.start("ddxctl", "watch", "sensor", "-count", "5", "-json")
    wait_until(lambda: '"readers":1,' in sensor.run("ddxctl", "list", "--json").stdout)
    first = shown(sensor)["sequence"]
    assert watcher.stdout
    writes = []
    for number in range(5):  # one at a time: a late watcher would report missed ones
        assert sensor.run("ddxctl", "set", "sensor", f"serial={number}").returncode == 0
        writes.append(json.loads(watcher.stdout.readline()))
    watcher.wait(60)
    assert [write["sequence"] for write in writes] == list(range(first + 1, first + 6))
    assert [write["missed"] for write in writes] == [0] * 5


def test_partly_valid_numbers_are_refused(sensor: Desk) -> None:
    assert sensor.run("ddxctl", "set", "sensor", "serial=010").returncode == 0
    assert shown(sensor)["value"]["serial"] == 10
    for value in ("\t-5", " -5", "0x", "--5", "5 "):
        assert "takes a whole number" in refused(sensor, f"serial={value}")
