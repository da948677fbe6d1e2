# SPDX-License-Identifier: GPL-2.0-or-later
"""From the store over the network to a picture, without loss."""
from __future__ import annotations

import pathlib

import pytest

from parts.media import clip as numbered_clip

from .stream import Stream, drawn, finish, printed, stop_recording

FRAMES = 25
CODECS = ["h264", "mpeg4"]


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    return numbered_clip.write(tmp_path_factory.mktemp("clip") / "clip.y4m", FRAMES // numbered_clip.RATE)


@pytest.mark.parametrize("codec", CODECS)
def test_every_frame_arrives(stream: Stream, clip: pathlib.Path, codec: str) -> None:
    decode, sender = stream.decode(), stream.send("-codec", codec)
    recorder = stream.record(clip)
    stream.play(clip, "-rate", "0.25")  # the sender keeps no frame, and has other things to do on a busy machine
    (_, sent_packets, sent), (lines, packets, shown) = finish(sender, decode)
    stop_recording(recorder)
    for counters in (sent, shown):
        assert (counters["in"], counters["out"], sum(counters["lost"].values())) == (FRAMES + 1, FRAMES + 1, 0)
    assert packets["received"] == packets["used"] == sent_packets["packets"] > FRAMES
    assert packets["bytes"] == sent_packets["bytes"]
    # What the pictures show is what was said of them, and all of it.
    assert printed(lines) == [0, *range(FRAMES)]
    assert drawn(stream.folder / "seen.y4m") == list(range(FRAMES))
