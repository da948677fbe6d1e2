# SPDX-License-Identifier: GPL-2.0-or-later
"""The stream over IPv6, to a group and single receivers, together with IPv4; frames are judged by their numbers."""
from __future__ import annotations

import pathlib

import pytest

from parts.media import clip as numbered_clip

from .programs import Process, ffmpeg, pictures, wait_until
from .stream import GROUP, Stream, finish, printed

pytestmark = pytest.mark.strict

GROUP_IPV6 = "ff15::5"
ONE_SECOND = 1


def start_decode(stream: Stream, name: str, *options: object) -> Process:
    """Start a ddxdecode that records the stream."""
    process = stream.desk.start("ddxdecode", "-headless", "-print", "-instance", name, "-record", f"{name}.mkv",
                                *options, wrapper=stream.network.inside)
    wait_until(lambda: f"{name}.packets" in stream.desk.run("ddxctl", "list").stdout)
    return process


def drawn_numbers(movie: pathlib.Path) -> list[int | None]:
    """The numbers in the pictures of a recorded stream."""
    y4m = movie.with_suffix(".y4m")
    ffmpeg("-i", movie, "-fps_mode", "passthrough", "-pix_fmt", "yuv420p", "-y", y4m)
    return [numbered_clip.frame_number(picture, numbered_clip.WIDTH, numbered_clip.HEIGHT) for picture in pictures(y4m)]


def test_one_stream_to_ipv6_and_ipv4(stream: Stream, tmp_path: pathlib.Path) -> None:
    """Group and single receivers see the same frames of one sender over IPv6 and IPv4. `direct` gets each packet twice,
    since it takes both at one port. `other` uses the group's port without joining the group, and gets nothing although
    another program on its machine has joined."""
    clip = numbered_clip.write(tmp_path / "clip.y4m", ONE_SECOND)
    decodes = [start_decode(stream, "group", "-group", GROUP_IPV6, "-interface", "lo"),
               start_decode(stream, "direct", "-group", "none", "-port", 9000),
               start_decode(stream, "other", "-group", GROUP)]
    sender = stream.send("-group", GROUP_IPV6, "-interface", "lo", "-to", "[::1]:9000,127.0.0.1:9000", "-sdp",
                         "stream.sdp")
    stream.play(clip, "-rate", 2)
    (_, sent_packets, sent), = finish(sender)
    wait_until(lambda: stream.desk.out("group") == stream.desk.out("direct") == int(sent["out"]))  # all is read
    (lines, packets, _), (direct, twice, _), (_, other, _) = finish(*decodes)
    assert sent["lost"]["network"] == 0 and sent["out"] >= 3
    assert "c=IN IP6 ff15::5\n" in (stream.folder / "stream.sdp").read_text()
    # A report that comes before the last frame makes the sender send repair packets, too. A busy machine may read one
    # of these first, and restore a packet from it: the packet itself is then a duplicate.
    media = sent_packets["media"]
    assert sent_packets["packets"] == 3 * (media + sent_packets["repairs"])
    assert packets["used"] == twice["used"] == media
    assert packets["duplicate"] == packets["restored"] and twice["duplicate"] == media + twice["restored"]
    assert other["received"] == 0
    assert len(printed(lines)) == sent["out"] and printed(lines) == printed(direct)
    assert drawn_numbers(tmp_path / "group.mkv") == drawn_numbers(tmp_path / "direct.mkv") == printed(lines)
