# SPDX-License-Identifier: GPL-2.0-or-later
"""A foreign sender: frames of FFmpeg's encoders, or made without an encoder, as RTP packets."""
from __future__ import annotations

import pathlib
import random
import struct
import subprocess

from .programs import ffmpeg
from .stream import PORT, Network

H264, MPEG4 = 96, 97
LARGEST = 1000
SEND = """
import socket, sys
data, out = sys.stdin.buffer.read(), socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
while data:
    size = int.from_bytes(data[:2], "big")
    out.sendto(data[2:2 + size], ("127.0.0.1", int(sys.argv[1])))
    data = data[2 + size:]
"""
Frames = list[bytes]


def encode(codec: int, frames: int, size: str, pixels: str = "yuv420p") -> Frames:
    """Encoded frames; the first one is a key frame with all headers."""
    words = {H264: "libx264 -preset ultrafast -tune zerolatency -threads 1 -x264-params aud=1 -f h264",
             MPEG4: "mpeg4 -f m4v"}[codec]
    data = ffmpeg("-f", "lavfi", "-i", "testsrc2=size=64x48:rate=25", "-frames:v", frames, "-pix_fmt", pixels,
                  "-vf", f"scale={size.replace('x', ':')}", "-g", 250, "-c:v", *words.split(), "-")
    mark = b"\0\0\0\1\x09" if codec == H264 else b"\0\0\1\xb6"
    head, *parts = data.split(mark)
    found = [mark + part for part in parts]
    assert len(found) == frames
    return [head + found[0], *found[1:]]


class Bits:
    def __init__(self) -> None:
        self.text = ""

    def fixed(self, width: int, *values: int) -> Bits:
        self.text += "".join(f"{value:0{width}b}" for value in values)
        return self

    def golomb(self, *values: int) -> Bits:
        """Append values as unsigned Exp-Golomb, which is also right for a signed 0."""
        for value in values:
            self.text += "0" * (len(f"{value + 1:b}") - 1) + f"{value + 1:b}"
        return self

    def bytes(self, tail: bytes = b"") -> bytes:
        """The bits with the stop bit."""
        text = self.text + "1"
        text += "0" * (-len(text) % 8)
        return int(text, 2).to_bytes(len(text) // 8, "big") + tail


def large_h264(width: int, height: int, references: int = 1) -> bytes:
    """A frame of a few hundred bytes that claims this size: parameter sets, and noise as its slice."""
    sps = Bits().fixed(8, 66, 0, 62).golomb(0, 0, 2, references).fixed(1, 0).golomb(width // 16 - 1, height // 16 - 1)
    pps = Bits().golomb(0, 0).fixed(1, 0, 0).golomb(0, 0, 0).fixed(1, 0, 0, 0).golomb(0, 0, 0).fixed(1, 0, 0, 0)
    slice_head = Bits().golomb(0, 7, 0).fixed(4, 0).golomb(0).fixed(1, 0, 0).golomb(0)
    noise = bytes(byte | 1 for byte in random.Random(1).randbytes(500))
    units = (b"\x67" + sps.fixed(1, 1, 1, 0, 0).bytes(), b"\x68" + pps.bytes(), b"\x65" + slice_head.bytes(noise))
    return b"".join(b"\0\0\0\1" + unit for unit in units)


def large_mpeg4(width: int, height: int) -> bytes:
    vol = Bits().fixed(1, 0).fixed(8, 1).fixed(1, 0).fixed(4, 1).fixed(1, 0).fixed(2, 0).fixed(1, 1).fixed(16, 25)
    vol.fixed(1, 1, 0, 1).fixed(13, width).fixed(1, 1).fixed(13, height).fixed(1, 1, 0, 1, 0, 0, 0, 1, 1, 0, 0)
    vop = Bits().fixed(2, 0).fixed(1, 0, 1).fixed(5, 0).fixed(1, 1, 1).fixed(3, 0).fixed(5, 8)
    noise = bytes(byte | 1 for byte in random.Random(1).randbytes(500))
    return b"\0\0\1\xb0\1\0\0\1\xb5\x09\0\0\1\0\0\0\1\x20" + vol.bytes() + b"\0\0\1\xb6" + vop.bytes(noise)


def payloads(codec: int, frame: bytes) -> list[bytes]:
    """Payloads by RFC 6184, 5.6 and 5.8, or by RFC 6416, which allows any split."""
    if codec == MPEG4:
        return [frame[at:at + LARGEST] for at in range(0, len(frame), LARGEST)]
    found = []
    for unit in frame.split(b"\0\0\1"):
        unit = unit.rstrip(b"\0")
        if 0 < len(unit) <= LARGEST:
            found.append(unit)
            continue
        parts = [unit[at:at + LARGEST] for at in range(1, len(unit), LARGEST)]
        for number, part in enumerate(parts):
            edge = 0x80 * (number == 0) | 0x40 * (number == len(parts) - 1)
            found.append(bytes([unit[0] & 0xe0 | 28, edge | unit[0] & 31]) + part)
    return found


class Source:
    """Sends frames to ddxdecode, with continuous packet numbers."""

    def __init__(self, network: Network, codec: int, ssrc: int = 1) -> None:
        self.network, self.codec, self.ssrc = network, codec, ssrc
        self.sequence = self.time = self.sent = 0

    def send(self, frames: Frames) -> None:
        out = b""
        for frame in frames:
            self.time += 3600
            parts = payloads(self.codec, frame)
            for number, payload in enumerate(parts):
                marker = 0x80 * (number == len(parts) - 1)
                head = struct.pack(">BBHII", 0x80, marker | self.codec, self.sequence & 0xffff, self.time, self.ssrc)
                self.sequence += 1
                out += struct.pack(">H", len(head + payload)) + head + payload
        subprocess.run([*self.network.inside, "/usr/bin/python3", "-c", SEND, str(PORT)], input=out, check=True)
        self.sent += len(frames)


def memory_mib(pid: int) -> int:
    """The peak memory of the process in MiB."""
    line = next(line for line in pathlib.Path(f"/proc/{pid}/status").read_text().splitlines() if "VmHWM" in line)
    return int(line.split()[1]) >> 10
