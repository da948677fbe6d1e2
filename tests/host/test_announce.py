# SPDX-License-Identifier: GPL-2.0-or-later
"""Announcements of streams (SAP): the packets on the network, and the output of `ddxdecode -list`."""
from __future__ import annotations

import dataclasses
import ipaddress
import pathlib
import socket
import subprocess
from collections.abc import Iterator

import pytest

from .programs import Process, make_clip
from .stream import Stream, finish

pytestmark = pytest.mark.retry

LISTEN = """
import socket, struct, sys
group = sys.argv[1]
family = socket.AF_INET6 if ":" in group else socket.AF_INET
inlet = socket.socket(family, socket.SOCK_DGRAM)
inlet.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
inlet.bind(("", 9875))
inlet.settimeout(30)
index = struct.pack("i", socket.if_nametoindex("lo"))
if family == socket.AF_INET6:
    inlet.setsockopt(41, socket.IPV6_JOIN_GROUP, socket.inet_pton(family, group) + index)
else:
    inlet.setsockopt(0, socket.IP_ADD_MEMBERSHIP, socket.inet_pton(family, group) + bytes(4) + index)
print("ready", flush=True)
while True:
    print(inlet.recv(65536).hex(), flush=True)
"""
THROW = """
import socket, sys
for word in sys.argv[1:]:
    socket.socket(socket.AF_INET, socket.SOCK_DGRAM).sendto(bytes.fromhex(word), ("127.0.0.1", 9875))
"""
PYTHON = ("/usr/bin/python3", "-B", "-c")
ADDRESS = "10.0.0.1"
GROUPS = {"239.255.20.5": "239.255.255.255", "ff15::5": "ff05::2:7ffe"}  # stream: announcements


@dataclasses.dataclass
class Message:
    """A SAP packet; RFC 2974, 6."""
    deletion: bool
    hash: int
    origin: str
    text: str

    @classmethod
    def parse(cls, data: bytes) -> Message:
        assert data[0] & 0xe3 == 0x20 and data[1] == 0, "version 1, plain, without authentication"
        end = 20 if data[0] & 0x10 else 8
        kind, _, text = data[end:].partition(b"\0")
        assert kind == b"application/sdp" and len(data) < 1024
        return cls(bool(data[0] & 4), int.from_bytes(data[2:4], "big"), str(ipaddress.ip_address(data[4:end])),
                   text.decode())

    def line(self, kind: str) -> str:
        return next(line[2:] for line in self.text.splitlines() if line.startswith(f"{kind}="))


class Listener:
    def __init__(self, stream: Stream, group: str) -> None:
        self.process = subprocess.Popen([*stream.network.inside, *PYTHON, LISTEN, group], stdout=subprocess.PIPE,
                                        text=True)
        assert self.next_line() == "ready\n"

    def next_line(self) -> str:
        assert self.process.stdout
        return self.process.stdout.readline()

    def next(self) -> Message:
        return Message.parse(bytes.fromhex(self.next_line()))

    def end(self) -> None:
        self.process.kill()
        self.process.communicate()


@pytest.fixture(params=GROUPS)
def group(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(autouse=True)
def address(stream: Stream) -> None:
    """Add an address: 127.0.0.1 cannot send to a group, so without another one nothing is announced."""
    subprocess.run([*stream.network.inside, "ip", "addr", "add", f"{ADDRESS}/32", "dev", "lo"], check=True)


@pytest.fixture
def listener(stream: Stream, group: str) -> Iterator[Listener]:
    one = Listener(stream, GROUPS[group])
    yield one
    one.end()


def start_list(stream: Stream) -> Process:
    """Start `ddxdecode -list` and wait until it has joined the groups."""
    process = stream.desk.start("ddxdecode", "-list", "-interface", "lo", wrapper=stream.network.inside)
    assert process.stdout and process.stdout.readline().split() == ["address", "port", "codec", "age", "name"]
    return process


def throw(stream: Stream, *datagrams: bytes) -> None:
    """Send to the announcements' port of this machine."""
    subprocess.run([*stream.network.inside, *PYTHON, THROW, *(one.hex() for one in datagrams)], check=True)


def listed(process: Process) -> list[list[str]]:
    """The lines of the table, split into words."""
    process.terminate()
    out, _ = process.communicate(timeout=60)
    assert process.returncode == 0
    return [line.split() for line in out.splitlines()]


def test_a_stream_is_announced_and_withdrawn(stream: Stream, tmp_path: pathlib.Path, listener: Listener,
                                              group: str) -> None:
    small, large = (make_clip(tmp_path / f"{size}.y4m", size, "25", 3) for size in ("64x48", "96x64"))
    listing = start_list(stream)
    sender = stream.send("-group", group, "-interface", "lo", "-port", 8002, "-sdp", "stream.sdp")
    stream.play(small)
    first = listener.next()
    name = f"{socket.gethostname()} ddxvideosend"
    assert not first.deletion and first.line("s") == name
    assert first.origin == ("::1" if ":" in group else ADDRESS)
    assert first.line("o").split()[2:] == ["1", "IN", "IP6" if ":" in group else "IP4", first.origin]
    # Except for origin and name, the announcement equals the description file for players.
    described = (tmp_path / "stream.sdp").read_text().splitlines()
    assert first.text.splitlines()[3:] == described[3:] and "m=video 8002 RTP/AVP 96" in described
    address, port, codec, _, unit, *rest = listed(listing)[0]
    assert (address, port, codec, unit, " ".join(rest)) == (group, "8002", "H264", "s", name)
    # A new picture size makes a new description: the first is withdrawn at once.
    stream.play(large)
    gone, second = listener.next(), listener.next()
    assert gone.deletion and gone.hash == first.hash and gone.text == f"o={first.line('o')}\r\n"
    assert not second.deletion and second.hash != first.hash and second.line("o").split()[2] == "2"
    finish(sender)
    last = listener.next()
    assert last.deletion and last.hash == second.hash and last.origin == second.origin


def test_cases_without_an_announcement(stream: Stream, tmp_path: pathlib.Path) -> None:
    listener = Listener(stream, "239.255.255.255")
    senders = [stream.send("-interface", "lo", "-sap", "no"),
               stream.send("-group", "none", "-to", "127.0.0.1", "-instance", "direct")]
    stream.play(make_clip(tmp_path / "clip.y4m", "64x48", "25", 3), readers=2)
    assert all(packets["packets"] > 0 for _, packets, _ in finish(*senders))
    throw(stream, b"end")
    assert listener.next_line() == b"end".hex() + "\n"
    listener.end()


def message(hash: int, name: bytes, deletion: bool = False) -> bytes:
    text = b"v=0\no=- 1 1 IN IP4 10.0.0.9\ns=" + name + b"\nc=IN IP4 239.1.2.3/1\nt=0 0\nm=video 5004 RTP/AVP 33\n"
    return bytes([0x24 if deletion else 0x20, 0]) + hash.to_bytes(2, "big") + bytes([10, 0, 0, 9]) + text


def test_the_list_shows_valid_announcements_only(stream: Stream) -> None:
    """Withdrawn and invalid announcements are left out; control characters in names have no effect."""
    listing = start_list(stream)
    throw(stream, message(1, b"one"), message(2, b"two"), message(1, b"one", deletion=True), message(2, b"two"),
          message(3, b"\x1b[2J\xc2\x9b"), b"", b"\x20", message(4, b"cut")[:40], b"x" * 5000)
    assert [(*line[:3], *line[5:]) for line in listed(listing)] == [
        ("239.1.2.3", "5004", "MPEG-TS", "?[2J??"), ("239.1.2.3", "5004", "MPEG-TS", "two")]
    empty = start_list(stream)
    assert listed(empty) == [] and "no stream is announced here" in stream.desk.errors(empty)
