# SPDX-License-Identifier: GPL-2.0-or-later
"""A machine's items as seen by other implementations of ROS 2 and DDS at the other end of a link."""
from __future__ import annotations

import json
import os
import pathlib
import re
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from parts.common import MORTAL, TOP, Failed
from parts.image import peers
from parts.link.link import Link

from .absent import not_made
from .programs import Compiler, Process, lost, stop, wait_until
from .test_catalog import Machine, link, read, write

pytestmark = pytest.mark.retry

__all__ = ["link"]  # a fixture

HERE = pathlib.Path(__file__).parent
MESSAGE = """std_msgs/Header header
uint64 sequence
int64 monotonic_ns
int32 number
uint8[5] name
ddx/SENSORPart[2] part
float32 f
uint8 last
"""
PART = "float64 x\nint16[3] a\n"


@pytest.fixture(scope="session")
def others() -> pathlib.Path:
    """The folder of the other implementations."""
    try:
        return peers.peers()
    except Failed as error:
        not_made("ROS 2 and other implementations of DDS cannot be installed", error)


class Laptop:
    """The other end, without a catalog or a store."""

    def __init__(self, folder: pathlib.Path, others: pathlib.Path, inside: tuple[str, ...]) -> None:
        self.folder, self.others, self._inside = folder, others, inside
        self.environment = {**os.environ, "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp", "ROS_LOG_DIR": str(folder),
                            "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4", "PYTHONUNBUFFERED": "1"}
        self.processes: list[Process] = []

    def start(self, program: str, *words: object) -> Process:
        with open(self.folder / "laptop", "a") as errors:
            process = subprocess.Popen([*MORTAL, *self._inside, self.others / "bin" / program, *map(str, words)],
                                       env=self.environment, text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                       stderr=errors)
        self.processes.append(process)
        return process

    def ros(self, *words: str) -> Process:
        return self.start("python", HERE / "ros_peer.py", *words)


@pytest.fixture
def laptop(tmp_path: pathlib.Path, others: pathlib.Path, link: Link) -> Iterator[Laptop]:
    laptop = Laptop(tmp_path, others, link.operator[0].inside)
    yield laptop
    for process in laptop.processes:
        process.kill()
        process.communicate()


Begin = Callable[[str], Machine]


@pytest.fixture
def begin(tmp_path: pathlib.Path, link: Link, compile_client: Compiler) -> Iterator[Begin]:
    started = list[Machine]()

    def begin(rules: str = "") -> Machine:
        started.append(Machine(tmp_path / "robot", "robot", link.robot, compile_client("catalog_client"), rules=rules))
        return started[0]

    yield begin
    for machine in started:
        machine.end()


def values(robot: Machine, *words: str) -> Process:
    """Start a writer of an item of any type."""
    return client(robot, "values_client.py", *words)


def client(robot: Machine, *words: str) -> Process:
    process = subprocess.Popen([*MORTAL, "/usr/bin/python3", "-B", HERE / words[0], *words[1:]], text=True,
                               stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                               env={**robot.desk.environment, "PYTHONPATH": str(TOP / "package/ddx/python")})
    robot.desk.processes.append(process)
    return process


def put(writer: Process, value: dict[str, Any]) -> str:
    """Write a value; return the writer's answer."""
    assert writer.stdin and writer.stdout
    writer.stdin.write(json.dumps(value) + "\n")
    writer.stdin.flush()
    answer = writer.stdout.readline()
    assert answer
    return answer


# The hash of a type from its definition alone. Arguments: TYPE, then name and text of each message.
ROSBAGS = """
import sys
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
store = get_typestore(Stores.ROS2_JAZZY)
for name, text in zip(sys.argv[2::2], sys.argv[3::2]):
    store.register(get_types_from_msg(text, name))
print(store.hash_rihs01(sys.argv[1]))
"""


def hash_of(laptop: Laptop, kind: str, *definitions: str) -> str:
    shown, _ = laptop.start("python", "-c", ROSBAGS, kind, *definitions).communicate(timeout=60)
    return shown.strip()


def shown_value(reader: Process) -> str:
    """The next message printed by `cyclonedds subscribe`, without spaces."""
    text = ""
    while not text.endswith("\n)\n"):
        text += read(reader, 1)[0]
    return re.sub(r"\s", "", text[text.index("SENSOR_("):])


def test_cyclonedds_finds_the_type_and_reads_the_values(begin: Begin, laptop: Laptop) -> None:
    writer = begin("").start("write", "sensor")
    write(writer, 3)
    tool = [laptop.start("cyclonedds", command, "--suppress-progress-bar", "--color", "none", "--runtime", "4s",
                         "rt/robot/sensor") for command in ("subscribe", "typeof")]
    for number in (3, 4):
        part = ",".join(f"SENSORPart_(x={1.5 * number + i},a=[{number + 10 * i},{number + 10 * i + 1},"
                        f"{number + 10 * i + 2}])" for i in (0, 1))
        assert f",number={number},name=b'abcde',part=[{part}],f=" in shown_value(tool[0])
        write(writer, 1)
    shown, _ = tool[1].communicate(timeout=60)
    for field in ("struct SENSOR_", "double x;", "short a[3];", "octet name[5];", "SENSORPart_ part[2];"):
        assert field in shown


# ROS's parser must accept the .msg files of a package.
ROSIDL = """
import pathlib, sys
from rosidl_adapter.parser import parse_message_file
for path in pathlib.Path(sys.argv[1]).glob("*.msg"):
    parse_message_file("ddx", str(path))
"""


def test_ros_finds_the_type_and_its_hash(begin: Begin, laptop: Laptop, tmp_path: pathlib.Path) -> None:
    """The hash equals that of the package written by `ddxctl rosmsgs`."""
    robot = begin("")
    write(robot.start("write", "sensor"), 1)
    node = laptop.ros("find", "/robot/sensor")
    done = robot.desk.run("ddxctl", "rosmsgs", "types")
    assert (done.returncode, done.stderr) == (0, "")
    package = robot.desk.folder / "types/ddx"
    assert {path.name for path in package.iterdir()} == {"CMakeLists.txt", "msg", "package.xml"}
    files = {path.stem: path.read_text() for path in (package / "msg").glob("*.msg")}
    assert (files["SENSOR"], files["SENSORPart"]) == (MESSAGE, PART)
    subprocess.run([laptop.others / "bin/python", "-c", ROSIDL, package / "msg"], check=True, timeout=60)
    words = [word for name, text in files.items() for word in (f"ddx/msg/{name}", text)]
    found = json.loads(read(node, 1)[0])
    assert found == ["ddx/msg/SENSOR", hash_of(laptop, "ddx/msg/SENSOR", *words)]


VECTOR = "struct { double x; double y; double z; }"
IMU = f"""struct {{ struct {{ double x; double y; double z; double w; }} orientation; double orientation_covariance[9];
    {VECTOR} angular_velocity; double angular_velocity_covariance[9];
    {VECTOR} linear_acceleration; double linear_acceleration_covariance[9]; }}"""
# Fields of several sizes after a name of any length.
FIX = """struct { struct { int8_t status; uint16_t service; } status; double latitude; double longitude;
    double altitude; double position_covariance[9]; uint8_t position_covariance_type; }"""


def imu(number: int) -> dict[str, Any]:
    def vector(first: float) -> dict[str, float]:
        return {"x": first, "y": first + 0.25, "z": first + 0.5}

    return {"orientation": {**vector(number), "w": 1.0}, "orientation_covariance": [float(i) for i in range(9)],
            "angular_velocity": vector(number + 0.125), "angular_velocity_covariance": [0.5] * 9,
            "linear_acceleration": vector(-number), "linear_acceleration_covariance": [number / 8] * 9}


def fix(number: int) -> dict[str, Any]:
    return {"status": {"status": -number, "service": 60000 + number}, "latitude": 48.25, "longitude": -11.5,
            "altitude": 519.0 + number, "position_covariance": [0.5] * 9, "position_covariance_type": number}


@pytest.mark.strict
def test_ros_reads_items_as_its_own_messages(begin: Begin, laptop: Laptop) -> None:
    """Every value arrives, in order and equal."""
    robot = begin("item imu as=sensor_msgs/msg/Imu topic=/imu/data\n"
                  "item fix as=sensor_msgs/msg/NavSatFix topic=/fix\nitem *\n")
    made = {"Imu": ("/imu/data", values(robot, "imu", "IMU", IMU), imu),
            "NavSatFix": ("/fix", values(robot, "fix", "FIX", FIX), fix)}
    nodes = {}
    for kind, (topic, writer, value) in made.items():
        put(writer, value(1))
        nodes[kind] = laptop.ros("listen", topic, f"sensor_msgs/msg/{kind}")
    for kind, (topic, writer, value) in made.items():
        message = json.loads(read(nodes[kind], 1)[0])
        for number in range(2, 22):
            header = message.pop("header")
            assert message == value(number - 1) and header["frame_id"] == "robot" and header["stamp"]["sec"] > 10**9
            put(writer, value(number))
            message = json.loads(read(nodes[kind], 1)[0])
    wait_until(lambda: bool(robot.counters()["out"] == 42))
    counters = robot.counters()
    assert counters["in"] == 42 and lost(counters) == 0


def test_an_item_that_does_not_match_its_message_is_reported(begin: Begin) -> None:
    robot = begin("item imu as=sensor_msgs/msg/Imu topic=/imu/data\n")
    put(values(robot, "imu", "IMU", "struct { struct { float x; } orientation; }"), {"orientation": {"x": 1}})
    said = "ddxcatalog: item imu as=sensor_msgs/msg/Imu: its field orientation.x is float32, not float64\n"
    wait_until(lambda: robot.desk.errors(robot.catalog) == said)


@pytest.mark.strict
def test_ros_sees_pictures(begin: Begin, laptop: Laptop) -> None:
    """Pictures of each common camera layout arrive with the expected bytes."""
    layouts = {"YUV420P": "rgb8", "RGB24": "rgb8", "GREY8": "mono8"}
    robot = begin("".join(f"item {name} as=sensor_msgs/msg/Image topic=/{name}\n" for name in layouts))
    nodes = {name: (client(robot, "pictures_client.py", name, name),
                    laptop.ros("listen", f"/{name}", "sensor_msgs/msg/Image")) for name in layouts}
    for name, (writer, node) in nodes.items():
        assert writer.stdin
        for number in range(10):
            writer.stdin.write(f"{number}\n")
            writer.stdin.flush()
            digest, = read(writer, 1)
            seen = json.loads(read(node, 1)[0])
            assert (seen["data"], seen["encoding"]) == (digest.strip(), layouts[name])
            assert (seen["width"], seen["height"]) == (352, 288) and seen["step"] == 352 * (1 + 2 * (name != "GREY8"))
    assert "over radio, use ddxvideosend" in robot.desk.errors(robot.catalog)
    wait_until(lambda: bool(robot.counters()["out"] == 30))
    assert lost(robot.counters()) == 0


def test_a_late_subscriber_of_ros_gets_the_newest_value(begin: Begin, laptop: Laptop) -> None:
    """A subscriber with durability transient_local does not match the topics of items that are not latched."""
    robot = begin("item imu latched as=sensor_msgs/msg/Imu topic=/imu/data\n")
    writer = values(robot, "imu", "IMU", IMU)
    for number in range(1, 4):
        put(writer, imu(number))
    for number in (3, 4):  # without another reader, and with one
        late = laptop.ros("late", "/imu/data", "sensor_msgs/msg/Imu")
        assert json.loads(read(late, 1)[0])["linear_acceleration"]["x"] == -number
        put(writer, imu(4))


@pytest.mark.strict
def test_a_value_that_is_too_large_for_a_message_is_reported(begin: Begin, laptop: Laptop) -> None:
    """A picture that would have 17 MB as rgb8."""
    robot = begin("item large as=sensor_msgs/msg/Image topic=/large\n")
    writer = client(robot, "pictures_client.py", "large", "YUV420P", "2560", "2240")
    laptop.ros("listen", "/large", "sensor_msgs/msg/Image")
    assert writer.stdin
    writer.stdin.write("1\n")
    writer.stdin.flush()
    read(writer, 1)
    wait_until(lambda: bool(robot.counters()["in"] == 1))
    counters = robot.counters()
    assert (counters["out"], counters["lost"]["size"], lost(counters)) == (0, 1, 1)


TWIST = f"struct {{ {VECTOR} linear; {VECTOR} angular; }}"


@pytest.mark.strict
def test_ros_writes_an_item(begin: Begin, laptop: Laptop) -> None:
    """A program of the robot has declared the item. Each value arrives once, in order, after both ends have found each
    other; before that DDS guarantees nothing, so ROS sends until the first value has arrived."""
    robot = begin("accept /cmd_vel as cmd type=geometry_msgs/msg/Twist\naccept /odd as odd type=std_msgs/msg/Int8\n"
                  "item cmd\n")
    values(robot, "cmd", "TWIST", TWIST).communicate("")
    reader, node = client(robot, "values_client.py", "cmd"), laptop.ros("talk", "/cmd_vel", "geometry_msgs/msg/Twist")
    wait_until(lambda: robot.desk.readers("cmd") == 1)
    sent = 0

    def twist(number: int) -> dict[str, Any]:
        return {"linear": {"x": number / 4, "y": 0.0, "z": -1.0}, "angular": {"x": 0.0, "y": 0.5, "z": number / 2}}

    def send() -> int:
        nonlocal sent
        sent += 1
        return int(put(node, twist(sent)))

    def arrives() -> bool:
        send()
        return robot.desk.sequence("cmd") > 0

    wait_until(arrives)
    values(robot, "odd", "ODD", "struct { float data; }").communicate("")
    wait_until(lambda: "accept /odd as odd: " in robot.desk.errors(robot.catalog))  # all items are checked in one pass
    for _ in range(20):
        assert send() == 1  # the catalog still uses its first reader
    seen = [json.loads(read(reader, 1)[0])]
    first = int(seen[0]["linear"]["x"] * 4)
    count = sent - first + 1
    wait_until(lambda: bool(robot.counters()["out"] == count))
    seen += map(json.loads, read(reader, count - 1))
    assert seen == [twist(number) for number in range(first, sent + 1)]
    assert robot.counters()["in"] == robot.desk.sequence("cmd") == count and lost(robot.counters()) == 0


def test_ros_reads_an_item_of_any_type(begin: Begin, laptop: Laptop) -> None:
    """With the package written by `ddxctl rosmsgs`."""
    writer = begin("").start("write", "sensor")
    write(writer, 1)
    package = str(peers.ros_package("ddx", {"SENSOR": MESSAGE, "SENSORPart": PART}))
    laptop.environment |= {"PYTHONPATH": package, "LD_LIBRARY_PATH": package}
    node = laptop.ros("listen", "/robot/sensor", "ddx/msg/SENSOR")
    for number in range(1, 21):
        message = json.loads(read(node, 1)[0])
        assert message["header"]["frame_id"] == "robot" and message["sequence"] == number == message["number"]
        assert (message["name"], message["last"]) == (list(b"abcde"), number)
        assert message["part"] == [{"x": 1.5 * number + i, "a": [number + 10 * i + k for k in range(3)]}
                                   for i in range(2)]
        write(writer, 1)


def test_a_catalog_stops_soon_while_readers_are_silent(begin: Begin, laptop: Laptop) -> None:
    """The catalog waits one second for all of them together."""
    robot = begin("")
    names = [f"s{number}" for number in range(8)]
    writers = [robot.start("write", name) for name in names]
    for writer in writers:
        write(writer, 1)
    package = str(peers.ros_package("ddx", {"SENSOR": MESSAGE, "SENSORPart": PART}))
    laptop.environment |= {"PYTHONPATH": package, "LD_LIBRARY_PATH": package}
    node = laptop.ros("listen", ",".join(f"/robot/{name}" for name in names), "ddx/msg/SENSOR")
    read(node, len(names))
    node.send_signal(signal.SIGSTOP)
    for writer in writers:
        write(writer, 1)
    wait_until(lambda: bool(robot.counters()["out"] == 2 * len(names)))
    begun = time.monotonic()
    assert stop(robot.catalog)[0] == 0
    assert time.monotonic() - begun < 3  # one second for each reader would take longer


def test_invalid_records_are_left_out_and_counted(begin: Begin, laptop: Laptop) -> None:
    """The limits of machines and items hold, and the catalog goes on."""
    robot = begin("")
    hostile = laptop.start("python", HERE / "hostile_catalog.py")
    assert read(hostile, 1) == ["32\n"] and hostile.stdin
    wait_until(lambda: len(robot.shown()["machines"]) == 32)
    hostile.stdin.write("\n")
    hostile.stdin.flush()
    refused = int(read(hostile, 1)[0]) - 256
    wait_until(lambda: bool(robot.shown()["refused"] == refused))
    shown = robot.shown()
    assert sorted(one["items"] for one in shown["machines"]) == [0] * 31 + [256]
    assert all(re.fullmatch("m1:i[0-9]+", one["name"]) for one in shown["items"] if ":" in one["name"])
    assert robot.catalog.poll() is None
    write(robot.start("write", "sensor"), 1)
    assert json.loads(read(laptop.ros("find", "/robot/sensor"), 1)[0])[0] == "ddx/msg/SENSOR"
