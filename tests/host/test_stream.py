# SPDX-License-Identifier: GPL-2.0-or-later
"""From the store over the network to a picture, without loss."""
from __future__ import annotations

import pathlib
import signal

import pytest

from parts.media import clip as numbered_clip

from .programs import lost, preload, result, send_signal, stop, wait_until
from .stream import TO_RELAY, Stream, drawn, finish, printed, stop_recording

pytestmark = pytest.mark.strict

FRAMES = numbered_clip.RATE  # in the clip's second
CODECS = ["h264", "mpeg4"]


@pytest.mark.parametrize("codec", CODECS)
def test_every_frame_arrives(stream: Stream, clip: pathlib.Path, codec: str) -> None:
    """The receiver reports nothing: if it were late on a busy machine, its reports would be those of a full link, for
    which the sender leaves frames out."""
    decode, sender = stream.decode("-silent"), stream.send("-codec", codec)
    recorder = stream.record(clip)
    stream.play(clip, "-rate", "0.1")  # slow, since the sender keeps no frame and may be delayed on a busy machine
    (_, sent_packets, sent), (lines, packets, shown) = finish(sender, decode)
    stop_recording(recorder)
    for counters in (sent, shown):
        assert (counters["in"], counters["out"], lost(counters)) == (FRAMES + 1, FRAMES + 1, 0), counters["lost"]
    assert packets["received"] == packets["used"] == sent_packets["packets"] > FRAMES
    assert packets["bytes"] == sent_packets["bytes"]
    # The pictures show exactly the printed numbers.
    assert printed(lines) == [0, *range(FRAMES)]
    assert drawn(stream.folder / "seen.y4m") == list(range(FRAMES))


def test_the_first_frames_are_counted(stream: Stream, clip: pathlib.Path) -> None:
    """A writer publishes all its frames at once after the sender has waited for the item: missed frames are counted."""
    sender = stream.send(*TO_RELAY)
    wait_until(lambda: "waiting for video" in stream.desk.errors(sender))
    stream.play(clip, "-rate", "0", readers=0)
    (_, _, sent), = finish(sender)
    assert (sent["in"], sent["out"] + sent["lost"]["store"]) == (FRAMES, FRAMES) and sent["out"] > 0


def test_no_frame_waits_for_the_encoder_s_first_use(stream: Stream, clip: pathlib.Path) -> None:
    """A writer that waits for a reader begins when the sender can encode: the first frames are not lost."""
    slow = stream.folder / "slow"
    slow.touch()
    sender = stream.send(*TO_RELAY, "-codec", "mpeg4", wrapper=(
        "env", f"LD_PRELOAD={preload('slow_encoder', stream.folder)}", f"SLOW_ENCODER={slow}"))
    loader = stream.desk.start("ddxvideoload", clip, "-readers", "1", "-rate", "0.25")
    wait_until(lambda: stream.desk.out("ddxvideoload") >= 5 or "waiting for 1 readers" in stream.desk.errors(loader))
    slow.unlink()
    assert result(loader)[0] == 0
    (_, _, sent), = finish(sender)
    assert (sent["in"], sent["out"], lost(sent)) == (FRAMES, FRAMES, 0)


def test_frames_and_packets_waiting_at_the_end_are_counted(stream: Stream, clip: pathlib.Path) -> None:
    """Stopped while frames wait in the store, or packets in the socket."""
    decode = stream.decode()
    sender = stream.send(wrapper=("env", f"LD_PRELOAD={preload('last_act', stream.folder)}", "LAST_ACT=written",
                                  "LAST_CALL=1", f"LAST_SIGNAL={signal.SIGSTOP.value}"))
    stream.play(clip)
    wait_until(lambda: stream.desk.out("ddxdecode") == 1)
    results = []
    send_signal(decode, signal.SIGSTOP)
    for process in (sender, decode):
        process.terminate()
        process.send_signal(signal.SIGCONT)
        results += finish(process)
    (_, _, sent), (lines, _, shown) = results
    # The sender was frozen when it counted the first frame; the second one may have been on its way.
    assert sent["in"] == FRAMES == sent["out"] + sent["lost"]["store"] and sent["out"] in (2, 3)
    assert shown["in"] == shown["out"] == sent["out"]
    assert printed(lines) == [0, 1][:sent["out"] - 1] + [FRAMES - 1]


def test_a_store_that_hangs(stream: Stream, clip: pathlib.Path) -> None:
    """The store hangs at the first picture: ddxdecode continues, counts the pictures that could not be stored, and then
    shows the rest."""
    decode, sender = stream.decode(), stream.send(*TO_RELAY)
    loader = stream.desk.start("ddxvideoload", clip, "-loop", "-readers", "1")
    wait_until(lambda: stream.desk.out("ddxvideosend") > 2)
    send_signal(stream.desk.store, signal.SIGSTOP)
    relay = stream.relay()
    wait_until(lambda: "seen: the store does not answer; trying again" in stream.desk.errors(decode))
    send_signal(stream.desk.store, signal.SIGCONT)
    wait_until(lambda: stream.desk.out("ddxdecode") > 10)
    assert stop(loader)[0] == 0
    (_, _, sent), (lines, _, shown) = finish(sender, decode)
    relay.terminate()
    assert shown["lost"]["store"] > 0 and shown["lost"]["decode"] == shown["lost"]["restart"] == 0
    assert shown["in"] == shown["out"] + lost(shown) <= sent["out"] and shown["starts"] == 1
    assert len(lines) == shown["out"] > 10
