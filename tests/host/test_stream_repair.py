# SPDX-License-Identifier: GPL-2.0-or-later
"""ddxdecode and a sender that repairs: pictures shown while packets are missing, and reports. The test itself is the
sender, so that it controls each packet."""
from __future__ import annotations

import dataclasses
import pathlib
import random
import struct
import subprocess
from collections.abc import Iterator

import pytest

from parts.common import TOP

from .programs import Compiler, wait_until
from .rtp_source import H264, Frames, encode, payloads
from .stream import PORT, Stream, finish

pytestmark = pytest.mark.strict

WINDOW = 25  # frames
SSRC = 7
REPAIR = PORT + 2
ROBOT = """
import signal, socket, sys, threading
signal.alarm(60)  # in case a report never comes
out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
out.bind(("127.0.0.1", 0))
def listen():
    while True:
        print(out.recv(2048).hex(), flush=True)
threading.Thread(target=listen, daemon=True).start()
for line in sys.stdin:
    port, data = line.split()
    out.sendto(bytes.fromhex(data), ("127.0.0.1", int(port)))
"""
SCREEN = {"SDL_VIDEODRIVER": "dummy"}


@dataclasses.dataclass
class Report:
    highest: int
    base: int
    missing: int
    refresh: bool


class Robot:
    """Sends packets from one socket, and receives reports there."""

    def __init__(self, stream: Stream, maker: pathlib.Path) -> None:
        self.maker = maker
        self.process = subprocess.Popen([*stream.network.inside, "/usr/bin/python3", "-c", ROBOT],
                                        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.sequence, self.count = 65500, 65530
        self.packets: list[bytes] = []  # all media packets
        self.frames: list[list[bytes]] = []

    def add(self, frames: Frames) -> None:
        """Make packets of the frames."""
        for frame in frames:
            parts, packets = payloads(H264, frame), []
            for number, payload in enumerate(parts):
                marker = 0x80 * (number == len(parts) - 1)
                head = struct.pack(">BBHII", 0x90, marker | H264, self.sequence & 0xffff, self.count * 3600, SSRC)
                head += struct.pack(">HHBHB", 0xbede, 1 if number else 6, 0x22, self.count & 0xffff, WINDOW)
                if not number:
                    head += struct.pack(">BQBIIxx", 0x17, 0xdead << 48, 0x37, self.count, self.count)
                packets.append(head + payload)
                self.sequence += 1
            self.count += 1
            self.frames.append(packets)
            self.packets += packets

    def send(self, *datagrams: bytes, port: int = PORT) -> None:
        assert self.process.stdin
        for one in datagrams:
            self.process.stdin.write(f"{port} {one.hex()}\n")
        self.process.stdin.flush()

    def send_frames(self, begin: int, end: int) -> None:
        self.send(*(packet for frame in self.frames[begin:end] for packet in frame))

    def repair(self, begin: int, end: int, count: int) -> None:
        """Send repair packets over these frames."""
        packets = [packet for frame in self.frames[begin:end] for packet in frame]
        data = b"".join(struct.pack(">H", len(packet)) + packet for packet in packets)
        made = subprocess.run([self.maker, str(count)], input=data, stdout=subprocess.PIPE, check=True).stdout
        while made:
            size, = struct.unpack(">H", made[:2])
            self.send(made[2:2 + size], port=REPAIR)
            made = made[2 + size:]

    def reports(self) -> Iterator[Report]:
        assert self.process.stdout
        for line in self.process.stdout:
            data = bytes.fromhex(line)
            assert data[:4] == b"\x8f\xce\x00\x07" and data[8:16] == struct.pack(">I", SSRC) + b"DDX1"
            assert len(data) == 32 or data[32:36] == b"\x81\xce\x00\x02"
            highest, base, missing = struct.unpack(">HHH", data[16:22])
            yield Report(highest, base, missing, len(data) > 32)

    def wait_for(self, highest: int, missing: int) -> Report:
        """Wait for the report with these values."""
        return next(one for one in self.reports() if (one.highest, one.missing) == (highest & 0xffff, missing))

    def end(self) -> None:
        self.process.terminate()
        self.process.communicate()


@pytest.fixture
def robot(stream: Stream, compile_client: Compiler) -> Iterator[Robot]:
    folders = [f"-iquote{TOP}/package/{name}" for name in ("ddxvideo/common", "ddx/program")]
    robot = Robot(stream, compile_client("repair_maker", words=folders))
    robot.add(encode(H264, 10, "64x48"))
    yield robot
    robot.end()


def last_of(robot: Robot, frame: int) -> int:
    return int.from_bytes(robot.frames[frame][-1][2:4], "big")


def stats(stream: Stream) -> dict[str, int]:
    """The frame counters that are not 0."""
    found = stream.desk.stats("ddxdecode")
    return {"in": int(found["in"]), "out": int(found["out"]),
            **{name: count for name, count in found["lost"].items() if count}}


def lose_one(stream: Stream, robot: Robot) -> None:
    """Send all frames except a packet of frame 4; wait until ddxdecode has reported it as missing."""
    for number in range(4):
        robot.send_frames(number, number + 1)
        wait_until(lambda: stats(stream) == {"in": number + 1, "out": number + 1})
    robot.send(*robot.frames[4][1:])
    robot.send_frames(5, 10)
    report = robot.wait_for(last_of(robot, 9), 1)
    assert report.base == last_of(robot, 3) + 1 and not report.refresh
    assert stats(stream) == {"in": 4, "out": 4}


def test_every_frame_of_a_backlog_is_in_the_item(stream: Stream, robot: Robot) -> None:
    decode = stream.decode("-group", "none")
    lose_one(stream, robot)
    robot.repair(3, 10, 1)
    wait_until(lambda: stats(stream) == {"in": 10, "out": 10})
    robot.wait_for(last_of(robot, 9), 0)
    assert stream.desk.sequence("seen") == 10
    (lines, packets, _), = finish(decode)
    assert len(lines) == 10 and not any("damaged" in line for line in lines)
    assert packets["restored"] == packets["repair_received"] == 1 and packets["lost"] == 0
    assert packets["used"] == len(robot.packets) == packets["received"] + 1
    assert packets["reports"] > 2 and packets["reports_lost"] == 0


def test_the_newest_of_a_backlog_is_on_the_screen(stream: Stream, robot: Robot) -> None:
    stream.desk.environment.update(SCREEN)
    stream.desk.start("ddxdecode", "-group", "none", wrapper=stream.network.inside)
    wait_until(lambda: "ddxdecode.packets" in stream.desk.run("ddxctl", "list").stdout)
    lose_one(stream, robot)
    robot.repair(3, 10, 1)
    wait_until(lambda: stats(stream) == {"in": 10, "out": 5, "newer": 5})


def test_a_packet_that_is_not_restored_is_given_up(stream: Stream, robot: Robot) -> None:
    """No picture is shown until it is whole again, which ddxdecode requests."""
    decode = stream.decode("-group", "none")
    robot.add(encode(H264, WINDOW + 5, "64x48")[1:])  # no key frame
    robot.send_frames(0, 4)
    robot.send_frames(5, len(robot.frames))
    hidden = len(robot.frames) - 5
    wait_until(lambda: stats(stream) == {"in": hidden + 5, "out": 4, "network": 1, "refresh": hidden})
    assert next(one for one in robot.reports() if one.refresh).missing == 0
    robot.add(encode(H264, 2, "64x48"))
    robot.send_frames(len(robot.frames) - 2, len(robot.frames))
    wait_until(lambda: stats(stream)["out"] == 6)
    assert not robot.wait_for(last_of(robot, -1), 0).refresh
    (_, packets, _), = finish(decode)
    assert packets["lost"] == len(robot.frames[4])


def test_conceal_shows_damaged_frames(stream: Stream, robot: Robot) -> None:
    """A damaged frame is shown without repair, and a new picture is requested."""
    decode = stream.decode("-group", "none", "-conceal")
    robot.send_frames(0, 4)
    robot.send(*robot.frames[4][1:])
    robot.send_frames(5, 10)
    assert next(one for one in robot.reports() if one.refresh and one.highest == last_of(robot, 9)).missing == 0
    wait_until(lambda: stats(stream) == {"in": 10, "out": 10})
    (lines, packets, _), = finish(decode)
    assert sum("damaged" in line for line in lines) == 1 and packets["lost"] == 1


def test_garbage_on_both_ports(stream: Stream, robot: Robot) -> None:
    """Also: a receiver without permission to send does not send."""
    decode, noise = stream.decode("-group", "none", "-silent"), random.Random(1)
    for number in range(10):
        for _ in range(100 if number else 0):  # ddxdecode first follows the source of the first packet
            head = bytes([0x80, 96]) if noise.random() < 0.3 else b""
            robot.send(head + noise.randbytes(noise.randint(1, 1200)))
            robot.send(noise.choice([b"", robot.packets[0], b"\x81\x62"]) + noise.randbytes(800), port=REPAIR)
        robot.send_frames(number, number + 1)
        wait_until(lambda: stats(stream) == {"in": number + 1, "out": number + 1})
    (_, packets, _), = finish(decode)
    assert packets["garbage"] + packets["foreign"] == packets["repair_received"] == packets["repair_refused"] == 900
    assert packets["reports"] == packets["reports_lost"] == 0
    assert robot.process.communicate()[0] == ""
