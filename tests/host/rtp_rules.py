# SPDX-License-Identifier: GPL-2.0-or-later
"""Rules for our streams on the wire, checked on captured packets by the RFCs alone."""
from __future__ import annotations

import dataclasses
import pathlib

LARGEST = 1200
SMALL = 780  # bytes of payload that fit in any packet
H264, MPEG4 = 96, 97
NTP_EPOCH = 2208988800


@dataclasses.dataclass
class Packet:
    size: int
    type: int
    marker: bool
    sequence: int
    time: int
    ssrc: int
    payload: bytes
    capture: float = 0  # s since 1970
    number: int = -1  # the frame's number at its source
    count: int = -1
    elements: tuple[int, ...] = ()  # ids of the header extension, in order


def captured(path: pathlib.Path) -> list[bytes]:
    """The packets that relay.py saved."""
    data, found = path.read_bytes(), []
    while data:
        size = int.from_bytes(data[:4], "big")
        found.append(data[4:4 + size])
        data = data[4 + size:]
    return found


def parse(data: bytes) -> Packet:
    """RFC 3550, 5.1; RFC 8285, 4.2."""
    assert data[0] >> 6 == 2 and not data[0] & 0x2f, "version 2, no padding, no contributing sources"
    packet = Packet(len(data), data[1] & 127, bool(data[1] >> 7), int.from_bytes(data[2:4], "big"),
                    int.from_bytes(data[4:8], "big"), int.from_bytes(data[8:12], "big"), data[12:])
    if data[0] & 16:
        assert data[12:14] == b"\xbe\xde"
        words = int.from_bytes(data[14:16], "big")
        elements, packet.payload = data[16:16 + 4 * words], data[16 + 4 * words:]
        assert words in (1, 6), "8 bytes, or 28 once per frame"
        while elements:
            if not elements[0]:
                elements = elements[1:]
                continue
            size = (elements[0] & 15) + 1
            value = elements[1:1 + size]
            packet.elements += (elements[0] >> 4,)
            if elements[0] >> 4 == 1:
                packet.capture = int.from_bytes(value, "big") / 2**32 - NTP_EPOCH
            if elements[0] >> 4 == 2:
                assert size == 3
                packet.count = int.from_bytes(value[:2], "big")
            if elements[0] >> 4 == 3:
                assert size == 8
                packet.number = int.from_bytes(value[4:8], "big")
            elements = elements[1 + size:]
    return packet


def begins_video_packet(payload: bytes) -> bool:
    """A start code, or a resync marker: 16 to 22 zeros and a one, ISO 14496-2, 6.3.5.2."""
    zeros = 8 * len(payload) - int.from_bytes(payload, "big").bit_length()
    return payload[:3] == b"\0\0\1" or 16 <= zeros <= 22


def h264_types(payload: bytes) -> list[int]:
    """Types of the NAL units that start in a payload; RFC 6184, 5.2."""
    kind = payload[0] & 31
    if kind == 28:
        return [payload[1] & 31] if payload[1] & 0x80 else []
    if kind != 24:
        return [kind]
    found, at = [], 1
    while at < len(payload):
        size = int.from_bytes(payload[at:at + 2], "big")
        assert size and at + 2 + size <= len(payload), "STAP-A"
        found.append(payload[at + 2] & 31)
        at += 2 + size
    return found


def frames_of(packets: list[Packet]) -> list[list[Packet]]:
    found: dict[int, list[Packet]] = {}
    for packet in packets:
        found.setdefault(packet.count, []).append(packet)
    return list(found.values())


def is_even(frame: list[Packet]) -> bool:
    """Whether fragments have equal size, and only parameter sets and a whole small frame are unfragmented."""
    sizes = [packet.size for packet in frame if packet.payload[0] & 31 == 28]
    whole = [h264_types(packet.payload) for packet in frame if packet.payload[0] & 31 != 28]
    slices = [kinds for kinds in whole if not set(kinds) <= {6, 7, 8}]
    if sum(len(packet.payload) for packet in frame) <= SMALL:
        return len(frame) == 1
    return len(slices) == (not sizes) and len(whole) - len(slices) <= 1 and max(sizes or [0]) - min(sizes or [0]) <= 1


def broken_rules(packets: list[Packet], rate: int = 25) -> set[str]:
    """The rules that one stream's packets break."""
    broken = set()
    types = {packet.type for packet in packets}
    if len(types) != 1 or len({packet.ssrc for packet in packets}) != 1:
        broken.add("one source, one payload type")
    if max(packet.size for packet in packets) > LARGEST:
        broken.add(f"at most {LARGEST} bytes")
    for before, packet in zip(packets, packets[1:]):
        if packet.sequence != (before.sequence + 1) % 65536:
            broken.add("sequence")
        if before.marker != (before.time != packet.time):
            broken.add("marker on the last packet of a frame, and only there")
        if packet.count >= 0 and (packet.count - before.count) % 65536 != before.marker:
            broken.add("frames are counted")
        if packet.elements and packet.elements != ((2, 1, 3) if before.marker else (2,)):
            broken.add("capture time and source in the first packet of a frame, and only there")
    first = [packet for packet in packets if packet.number >= 0]
    for before, packet in zip(first, first[1:]):
        clock = (packet.time - before.time) % 2**32 / 90000
        if abs(clock - packet.capture + before.capture) > 1e-3:
            broken.add("RTP's clock is the capture's")
    if types == {MPEG4} and not all(begins_video_packet(packet.payload) for packet in packets):
        broken.add("packets begin at video packets")
    if types == {H264}:
        begun = [(packet.count, kind) for packet in packets for kind in h264_types(packet.payload)]
        if not {kind for _, kind in begun} <= {1, 5, 6, 7, 8}:
            broken.add("NAL units that every decoder knows")
        heads = sorted({count for count, kind in begun if kind == 7})
        if not all(is_even(one) for one in frames_of(packets)):
            broken.add("a small frame is one packet, a larger one equal packets")
        if heads[:1] != [packets[0].count] or heads != sorted({count for count, kind in begun if kind == 8}) or any(
                b - a > rate for a, b in zip(heads, heads[1:])):
            broken.add("parameter sets at the start and every second")
    return broken
