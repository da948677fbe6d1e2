# SPDX-License-Identifier: GPL-2.0-or-later
"""More players, and players with a key; they open the stream by its .sdp file or with the key file, and are judged by
the numbers in their pictures. Other players: test_stream_players.py, test_vlc.py."""
from __future__ import annotations

import base64
import os
import pathlib
import re
import subprocess

import pytest

from parts.common import MORTAL
from parts.media import clip as numbered_clip

from .absent import need
from .programs import ffmpeg, pictures
from .stream import GROUP, PORT, Stream, make_key
from .test_stream_players import JOIN, SCREEN, SECONDS, follows, send, watch_window

ENOUGH = JOIN * numbered_clip.RATE + 50  # pictures
WHITELIST = "file,udp,rtp,srtp,crypto"
CIPHERS = "srtp-cipher=aes-128-icm,srtp-auth=hmac-sha1-80,srtcp-cipher=aes-128-icm,srtcp-auth=hmac-sha1-80"

__all__ = ["SECONDS"]  # of the clip
pytestmark = [pytest.mark.retry, pytest.mark.long]


@pytest.fixture(params=["open", "key"])
def sent(stream: Stream, clip: pathlib.Path, request: pytest.FixtureRequest) -> Stream:
    """An H.264 stream, without and with a key, with its description in stream.sdp."""
    make_key(stream.folder / "stream.key")
    send(stream, clip, *(("-key", "stream.key") if request.param == "key" else ()))
    return stream


def numbers(y4m: pathlib.Path) -> list[int | None]:
    """The numbers in the last 30 pictures."""
    return [numbered_clip.frame_number(picture, 352, 288) for picture in pictures(y4m)[-30:]]


def test_ffplay(sent: Stream) -> None:
    player = ["ffplay", "-v", "error", "-an", "-protocol_whitelist", WHITELIST, "stream.sdp"]
    process = subprocess.Popen([*MORTAL, *sent.network.inside, *player], cwd=sent.folder, env={**os.environ, **SCREEN})
    assert follows(watch_window(process, sent.folder, ENOUGH), 20)


def test_mpv(sent: Stream) -> None:
    """mpv writes each picture to a file."""
    need("mpv", "mpv")
    player = ["mpv", "--no-config", "--no-audio", "--really-quiet", "--profile=low-latency", f"--frames={ENOUGH}",
              "--vo=image", "--vo-image-format=png", "--vo-image-png-compression=1", "--vo-image-outdir=shown",
              f"--demuxer-lavf-o=protocol_whitelist=[{WHITELIST}]", "stream.sdp"]
    subprocess.run([*MORTAL, *sent.network.inside, *player], cwd=sent.folder, check=True, timeout=60,
                   env={**os.environ, "HOME": str(sent.folder)}, stdin=subprocess.DEVNULL)
    ffmpeg("-i", sent.folder / "shown/%08d.png", "-pix_fmt", "yuv420p", "-y", sent.folder / "seen.y4m")
    assert follows(numbers(sent.folder / "seen.y4m"), 20)


def key_of_gstreamer(stream: Stream) -> str:
    """The key in GStreamer's form, and the stream's SSRC."""
    key = base64.b64decode((stream.folder / "stream.key").read_bytes()).hex()
    said = "".join(path.read_text() for path in stream.folder.glob("errors-*"))
    found = re.search(r"SSRC (\w+)", said)
    assert found
    return f"ssrc=(uint){int(found[1], 16)},srtp-key=(buffer){key},{CIPHERS}"


def test_gstreamer_with_a_key(stream: Stream, clip: pathlib.Path) -> None:
    """GStreamer decrypts with its SRTP element; FFmpeg decodes the result."""
    make_key(stream.folder / "stream.key")
    send(stream, clip, "-key", "stream.key")
    caps = "application/x-srtp,media=video,clock-rate=90000,encoding-name=H264,payload=96," + key_of_gstreamer(stream)
    player = f"udpsrc address={GROUP} port={PORT} multicast-iface=lo caps={caps} ! srtpdec ! rtpjitterbuffer ! " \
        "rtph264depay ! h264parse ! video/x-h264,stream-format=byte-stream ! filesink location=seen.264"
    subprocess.run([*MORTAL, *stream.network.inside, "timeout", "--preserve-status", "--signal=INT", str(JOIN + 3),
                    "gst-launch-1.0", "-q", "-e", *player.split()], cwd=stream.folder, timeout=60, check=False)
    ffmpeg("-f", "h264", "-i", stream.folder / "seen.264", "-fps_mode", "passthrough", "-pix_fmt", "yuv420p", "-y",
           stream.folder / "seen.y4m")
    assert follows(numbers(stream.folder / "seen.y4m"), 25)
