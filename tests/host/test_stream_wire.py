# SPDX-License-Identifier: GPL-2.0-or-later
"""The stream on the wire and its quality, judged from packets and pictures only."""
from __future__ import annotations

import json
import pathlib
import subprocess

import numpy
import pytest

from bench.stream import ENCODE
from parts.media.footage import footage

from .programs import ffmpeg, pictures, result, wait_until
from .rtp_rules import broken_rules, captured, parse
from .stream import PORT, RELAYED, TO_RELAY, Stream, find_numbers, finish, printed, stop_recording

pytestmark = pytest.mark.strict

FRAMES = 150
BITRATE = 200  # kbit/s
LOW = 110
GOOD = 30  # dB
BYTES = 352 * 288 * 3 // 2


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    return footage(tmp_path_factory.mktemp("clip") / "clip.y4m", FRAMES, "352x288")


def psnr(ours: list[bytes], numbers: list[int], theirs: list[bytes]) -> float:
    """Mean over the frames of the PSNR over all three planes, in dB."""
    values = []
    for picture, number in zip(ours, numbers, strict=True):
        a, b = (numpy.frombuffer(data, numpy.uint8).astype(float) for data in (picture, theirs[number]))
        values.append(10 * numpy.log10(255**2 / max(numpy.mean((a - b) ** 2), 1e-3)))
    return float(numpy.mean(values))


def send_clip(stream: Stream, clip: pathlib.Path, codec: str, bitrate: int) -> tuple[float, float, pathlib.Path]:
    """Send the clip through a relay that saves packets; return PSNR, kbit/s on the wire (RTP, UDP, IP), the packets."""
    decode, relay = stream.decode("-group", "none"), stream.relay("copy=packets")
    sender = stream.send("-codec", codec, "-bitrate", bitrate, *TO_RELAY)
    recorder = stream.record(clip)
    stream.play(clip, "-rate", 2)
    finish(sender)
    relay.terminate()
    came = result(relay)[1]["came"]
    (lines, packets, shown), = finish(decode)
    stop_recording(recorder)
    assert packets["used"] == came and sum(shown["lost"].values()) == 0
    kept = captured(stream.folder / "packets")
    wire = sum(len(packet) + 28 for packet in kept) * 8 / (FRAMES / 25) / 1000
    return psnr(pictures(stream.folder / "seen.y4m"), printed(lines)[1:], pictures(clip)), wire, \
        stream.folder / "packets"


@pytest.mark.parametrize("codec", ["h264", "mpeg4"])
def test_rules_and_quality(stream: Stream, clip: pathlib.Path, codec: str) -> None:
    quality, wire, packets = send_clip(stream, clip, codec, BITRATE)
    parsed = [parse(packet) for packet in captured(packets)]
    assert len(parsed) > FRAMES // 2  # frames that a busy machine has time for
    assert broken_rules(parsed) == set()
    print(f"{codec}: {quality:.1f} dB, {wire:.0f} kbit/s on the wire")
    assert quality >= GOOD
    assert wire < 1.25 * BITRATE


@pytest.mark.parametrize("preset, good", [("h264", 31.5), ("ultrafast", 30.1)])
def test_encoder(tmp_path: pathlib.Path, clip: pathlib.Path, preset: str, good: float) -> None:
    """H.264 at a low rate, without a sender; ultrafast reached 29.0 dB with a renewal each second."""
    coded, decoded = tmp_path / "coded.264", tmp_path / "decoded.y4m"
    done = subprocess.run([ENCODE, clip, preset, str(LOW), coded], check=True, stdout=subprocess.PIPE)
    assert json.loads(done.stdout)["bytes"] == coded.stat().st_size <= LOW * 1000 / 8 * FRAMES / 25
    ffmpeg("-r", 25, "-i", coded, "-f", "yuv4mpegpipe", decoded)
    quality = psnr(pictures(decoded), list(range(FRAMES)), pictures(clip))
    print(f"{preset}: {quality:.1f} dB, {coded.stat().st_size * 8 * 25 / FRAMES / 1000:.0f} kbit/s")
    assert quality >= good


def test_bad_quality_is_found(stream: Stream, clip: pathlib.Path) -> None:
    quality, _, packets = send_clip(stream, clip, "h264", 20)
    assert quality < GOOD
    # Also broken rules are found in packets that keep them.
    parsed = [parse(packet) for packet in captured(packets)]
    assert broken_rules(parsed) == set()
    assert broken_rules(parsed[:50] + parsed[51:])
    parsed[50].size = 1201
    assert broken_rules(parsed) == {"at most 1200 bytes"}


def test_packets_split_at_wrong_places_are_found(stream: Stream) -> None:
    """FFmpeg's RTP muxer splits MPEG-4 where a packet is full, which breaks our rule."""
    relay = stream.relay("copy=packets")
    command = ["ffmpeg", "-v", "error", "-nostdin", "-f", "lavfi", "-i", "testsrc2=size=352x288:rate=25",
               "-frames:v", "50", "-c:v", "mpeg4", "-b:v", "1000k", "-ps", "800", "-payload_type", "97", "-f", "rtp",
               f"rtp://127.0.0.1:{RELAYED}?pkt_size=1000&rtcpport={PORT + 2}"]
    subprocess.run([*stream.network.inside, *command], check=True, timeout=60, stdout=subprocess.DEVNULL)
    relay.terminate()
    assert result(relay)[1]["came"] > 50
    assert "packets begin at video packets" in broken_rules([parse(p) for p in captured(stream.folder / "packets")])


def test_other_senders(stream: Stream) -> None:
    """A foreign stream is shown, with unknown frame numbers. Its claimed rate of 3,000,000 frames a second is not used
    for the item."""
    decode = stream.decode("-group", "none")
    command = ["ffmpeg", "-v", "error", "-nostdin", "-re", "-f", "lavfi", "-i", "testsrc2=size=352x288:rate=25",
               "-frames:v", "50", "-c:v", "libx264", "-tune", "zerolatency", "-bsf:v",
               "h264_metadata=tick_rate=6000000:fixed_frame_rate_flag=1", "-payload_type", "96", "-f", "rtp",
               f"rtp://127.0.0.1:{PORT}?pkt_size=1200"]
    subprocess.run([*stream.network.inside, *command], check=True, timeout=60, stdout=subprocess.DEVNULL)
    wait_until(lambda: int(stream.desk.stats("ddxdecode")["out"]) == 50)
    picture = find_numbers(json.loads(stream.desk.run("ddxctl", "show", "--json", "seen").stdout))
    assert (picture["width"], picture["rate_num"], picture["rate_den"]) == (352, 0, 0)
    (_, packets, shown), = finish(decode)
    assert shown["in"] == 50 and packets["lost"] == 0
