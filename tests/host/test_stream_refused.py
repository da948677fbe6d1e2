# SPDX-License-Identifier: GPL-2.0-or-later
"""Streams that cannot be shown: each frame is counted, one line reports why, and ddxdecode goes on."""
from __future__ import annotations

import pathlib

import pytest

from .programs import lost, make_clip, stop, wait_until
from .rtp_source import H264, MPEG4, Frames, Source, encode, large_h264, large_mpeg4, memory_mib
from .stream import Stream, finish

pytestmark = pytest.mark.strict

MOST = 150  # MiB; one picture of 16000x16000 has 366
SIZE = "a stream of 16000x16000 that cannot be shown: more than 11184810 pixels, what the store can hold"
FORMAT = "a stream that cannot be shown: its samples have more than 8 bits, or it is RGB"


def streams(codec: int) -> tuple[Frames, list[tuple[Frames, str]]]:
    """A good stream, and bad ones with the expected messages."""
    if codec == H264:
        many = [large_h264(3200, 3200, 16)]
        return encode(H264, 3, "64x48"), [([large_h264(16000, 16000)] * 2, SIZE),
                                          (many, "a stream of 3200x3200 that cannot be shown: it wants too many"),
                                          (encode(H264, 3, "64x48", "yuv422p10le"), FORMAT),
                                          (encode(H264, 3, "64x48", "yuv420p10le"), "")]
    size = "a stream of 8000x8000 that cannot be shown: more than 11184810 pixels"
    studio = [b"\0\0\1\xb0\xe1" + frame for frame in encode(MPEG4, 2, "64x48")]
    return encode(MPEG4, 3, "64x48"), [([large_mpeg4(8000, 8000)] * 2, size), (studio, FORMAT),
                                       (encode(MPEG4, 3, "65x49"), "a stream of 65x49 that cannot be shown: the store")]


@pytest.mark.parametrize("codec", [H264, MPEG4])
def test_decode_goes_on_after_streams_that_cannot_be_shown(stream: Stream, codec: int) -> None:
    good, bad = streams(codec)
    decode, source = stream.decode("-group", "none"), Source(stream.network, codec)
    refused = 0
    for frames, _ in bad:
        source.send(frames)
        refused += len(frames)
        source.send(good)
        wait_until(lambda: int(stream.desk.stats("ddxdecode")["in"]) == source.sent)
        counters = stream.desk.stats("ddxdecode")
        assert counters["out"] == source.sent - refused
        assert counters["lost"]["decode"] == lost(counters) == refused
    assert memory_mib(decode.pid) < MOST
    (_, packets, _), = finish(decode)
    assert packets["received"] == packets["used"]
    said = stream.desk.errors(decode).splitlines()
    for words in filter(None, (words for _, words in bad)):
        assert [line.count(words) for line in said].count(1) == 1, words
    assert sum("cannot be shown" in line for line in said) == 3


def test_the_store_refuses(stream: Stream, tmp_path: pathlib.Path) -> None:
    """Another program writes the item; once it has exited, the pictures are stored."""
    clip = make_clip(tmp_path / "clip.y4m", "64x48", "25", 25)
    other = stream.desk.start("ddxvideoload", clip, "-loop", "-name", "seen")
    wait_until(lambda: stream.desk.sequence("seen") > 0)
    good = encode(H264, 3, "64x48")
    decode, source = stream.decode("-group", "none"), Source(stream.network, H264)
    source.send(good)
    wait_until(lambda: int(stream.desk.stats("ddxdecode")["in"]) == 3)
    assert stream.desk.stats("ddxdecode")["lost"]["decode"] == 3
    assert stop(other)[0] == 0

    def is_shown() -> bool:
        source.send(good)
        return stream.desk.out("ddxdecode") > 0
    wait_until(is_shown)
    (_, _, counters), = finish(decode)
    assert counters["in"] == source.sent == counters["out"] + counters["lost"]["decode"]
    assert stream.desk.errors(decode).count("the store refuses the pictures") == 1


def test_a_window_limits_the_size(stream: Stream) -> None:
    """Without an item there is no store that would refuse."""
    decode = stream.desk.start("ddxdecode", "-headless", "-group", "none", wrapper=stream.network.inside)
    wait_until(lambda: "ddxdecode.packets" in stream.desk.run("ddxctl", "list").stdout)
    source = Source(stream.network, H264)
    source.send([large_h264(16000, 16000)])
    source.send(encode(H264, 3, "64x48"))
    wait_until(lambda: int(stream.desk.stats("ddxdecode")["in"]) == source.sent)
    assert memory_mib(decode.pid) < MOST
    (_, _, counters), = finish(decode)
    assert counters["out"] == 3 and counters["lost"]["decode"] == 1
    assert "more than 16777216 pixels;" in stream.desk.errors(decode)
