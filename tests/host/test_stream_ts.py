# SPDX-License-Identifier: GPL-2.0-or-later
"""The video as MPEG-TS over RTP: packets are judged by the standards, frames by the numbers in their pictures."""
from __future__ import annotations

import pathlib

import pytest

from parts.link.loss import NOTHING
from parts.media import clip as numbered_clip

from . import two_ends
from .programs import ffmpeg, pictures, result
from .rtp_rules import captured
from .stream import RELAYED, Stream, finish

pytestmark = pytest.mark.strict

TS = 188
PAT, VIDEO = 0, 256  # PIDs
SECONDS = 1
WIRE, TS_PORT = 300, 8100


def split(packets: list[bytes]) -> list[bytes]:
    """The transport packets in RTP packets of one source; RFC 2250, 2: payload type 33, whole transport packets."""
    sequence = [int.from_bytes(packet[2:4], "big") for packet in packets]
    assert all((b - a) % 65536 == 1 for a, b in zip(sequence, sequence[1:]))
    assert {packet[:2] for packet in packets} == {b"\x80\x21"} and len({packet[8:12] for packet in packets}) == 1
    assert max(len(packet) for packet in packets) <= 12 + 7 * TS
    data = b"".join(packet[12:] for packet in packets)
    found = [data[at:at + TS] for at in range(0, len(data), TS)]
    assert all(len(packet) == TS and packet[0] == 0x47 for packet in found)
    return found


def pid(packet: bytes) -> int:
    return int.from_bytes(packet[1:3], "big") & 0x1fff


def clock(packet: bytes) -> int | None:
    """PCR, 90 kHz; ISO 13818-1, 2.4.3.5."""
    has = packet[3] & 0x20 and packet[4] and packet[5] & 0x10
    return int.from_bytes(packet[6:11], "big") >> 7 if has else None


def check_joining(found: list[bytes]) -> int:
    """Check what a joining player needs: a clock with each frame, and the tables every 0.3 s or with the next frame
    after that. Returns the number of frames."""
    clocks = [clock(packet) for packet in found if pid(packet) == VIDEO and packet[1] & 0x40]
    times = [time for time in clocks if time is not None]
    assert len(times) == len(clocks)
    longest = max(b - a for a, b in zip(times, times[1:]))  # a busy machine skips frames
    now = table = times[0]
    for packet in found:
        now = clock(packet) or now
        if pid(packet) == PAT:
            assert now - table <= 27000 + longest
            table = now
    assert now - table <= 27000 + longest
    return len(times)


def test_mpeg_ts_stays_within_the_rate(tmp_path: pathlib.Path) -> None:
    """Counted by a relay. Each packet is sent or counted as lost, and the main stream's frames leave room for it."""
    clip = numbered_clip.write(tmp_path / "clip.y4m", 2 * SECONDS)
    run = two_ends.run(tmp_path, clip, NOTHING, NOTHING, "-wire", WIRE, "-ts", TS_PORT)
    way, packets = run.counts.down[0], run.sent_packets
    print(run)
    assert run.beyond_rate(WIRE) == [] and packets["wire_bytes"] == way.bytes
    assert packets["others"] == way.ports[TS_PORT].packets > run.sent["out"] / 2
    assert packets["ts_packets"] + packets["ts_lost"] == 2 * (packets["others"] + packets["others_lost"])
    assert run.sent["lost"]["network"] == 0 and run.sent["out"] >= run.sent["in"] / 2


@pytest.mark.parametrize("codec", ["h264", pytest.param("mpeg4", marks=pytest.mark.long)])
def test_mpeg_ts_has_all_frames(stream: Stream, tmp_path: pathlib.Path, codec: str) -> None:
    clip = numbered_clip.write(tmp_path / "clip.y4m", SECONDS)
    relay = stream.relay("copy=packets")
    # A machine that is named twice gets the packets once. Nothing listens at port 9100.
    # High enough for MPEG-4's large key frames.
    sender = stream.send("-codec", codec, "-group", "none", "-to", "127.0.0.1:9100,127.0.0.1:9102", "-ts", RELAYED,
                         "-wire", 4000)
    stream.play(clip, "-rate", "2")
    (_, packets, sent), = finish(sender)
    relay.terminate()
    assert result(relay)[1]["came"] == packets["ts_packets"] and packets["ts_lost"] == 0
    found = split(captured(tmp_path / "packets"))
    assert check_joining(found) == sent["out"]
    (tmp_path / "seen.ts").write_bytes(b"".join(found))
    ffmpeg("-i", tmp_path / "seen.ts", "-fps_mode", "passthrough", "-pix_fmt", "yuv420p", "-y", tmp_path / "seen.y4m")
    numbers = [numbered_clip.frame_number(picture, 352, 288) for picture in pictures(tmp_path / "seen.y4m")]
    assert len(numbers) == sent["out"] > 5 and len(set(numbers)) == len(numbers) and None not in numbers
    assert numbers == sorted(number for number in numbers if number is not None)
