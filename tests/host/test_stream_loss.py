# SPDX-License-Identifier: GPL-2.0-or-later
"""A bad network: ddxdecode counts exactly the relay's faults, and good pictures come back."""
from __future__ import annotations

import json
import pathlib
import signal
import time

import pytest

from parts.media import clip as numbered_clip

from .programs import Counters, Process, lost, result, send_signal, wait_until
from .stream import TO_RELAY, Stream, drawn, finish, printed, stop_recording, turn

pytestmark = pytest.mark.strict

SECONDS = 4
FRAMES = SECONDS * numbered_clip.RATE
# Frames until pictures are whole again on ddxdecode's request: for H.264 the current renewal and one more; for MPEG-4 a
# key frame, at most one a second. Includes half a second for a report on a busy machine.
BUSY = numbered_clip.RATE // 2
RECOVERY = {"h264": 2 * 22 + BUSY, "mpeg4": numbered_clip.RATE + BUSY}
WHOLE = 30  # frames after that
BAD = {
    "all": ["drop=15", "duplicate=10", "reorder=10", "foreign=10", "garbage=10"],
    "late": ["delay=10"],
}


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    return numbered_clip.write(tmp_path_factory.mktemp("short") / "clip.y4m", 1)


def end_relay(relay: Process) -> Counters:
    relay.terminate()
    return result(relay)[1]


def through_relay(stream: Stream, clip: pathlib.Path, codec: str, words: list[str],
                  *options: object) -> tuple[Counters, Counters, dict[str, int], Counters, list[int]]:
    """Play the clip through a bad network, then through a good one. Returns the relay's faults, the sender's frame
    counters, and ddxdecode's packet counters, frame counters and printed numbers."""
    decode = stream.decode("-group", "none", *options)
    relay = stream.relay(*words)  # of the media port only: repair packets are lost
    sender = stream.send("-codec", codec, "-wire", 2000, "-bitrate", 1200, "-repair", "off", *TO_RELAY)
    recorder = stream.record(clip)
    turn(relay, "bad")
    stream.play_frames(clip, FRAMES)
    turn(relay, "good")
    stream.play_frames(clip, RECOVERY[codec] + WHOLE)
    (_, _, sent), = finish(sender)
    did = end_relay(relay)
    (lines, packets, shown), = finish(decode)
    stop_recording(recorder)
    return did, sent, packets, shown, printed(lines)


def last_playing(numbers: list[int]) -> list[int]:
    """The frames shown since the last start of the clip."""
    begins = [at for at, (before, number) in enumerate(zip(numbers, numbers[1:]), 1) if number < before]
    return numbers[begins[-1]:] if begins else numbers


def disagreements(did: Counters, packets: dict[str, int]) -> list[str]:
    """Differences between ddxdecode's counters and the relay's faults."""
    pairs = {"drop": packets["lost"] - packets["late"], "duplicate": packets["duplicate"],
             "foreign": packets["foreign"], "garbage": packets["garbage"]}
    found = [f"{name}: {did[name]}, counted {count}" for name, count in pairs.items() if did[name] != count]
    parts = sum(packets[name] for name in ("used", "late", "duplicate", "foreign", "garbage"))
    if packets["received"] != parts:
        found.append(f"received {packets['received']}, accounted for {parts}")
    return found


@pytest.mark.parametrize("codec", ["h264", "mpeg4"])
@pytest.mark.parametrize("bad, options", [("all", []), ("late", ["-conceal"])])
def test_counters_and_recovery(stream: Stream, clip: pathlib.Path, codec: str, bad: str, options: list[str]) -> None:
    did, sent, packets, shown, numbers = through_relay(stream, clip, codec, BAD[bad], *options)
    assert all(did[word.split("=")[0]] > 5 for word in BAD[bad])
    assert disagreements(did, packets) == []
    assert packets["reordered"] > 0 or not did["reorder"]
    assert packets["late"] > 0 or not did["delay"]
    assert packets["sources"] == 1
    # Each sent frame was shown or is counted as lost.
    assert shown["in"] == sent["out"] and shown["in"] == shown["out"] + sum(shown["lost"].values())
    # Each picture has its printed number; if damaged ones are shown, some time after the network became good.
    assert len(numbers) == shown["out"] and len(last_playing(numbers)) >= WHOLE
    said = [number % FRAMES for number in numbers]  # numbers continue when the clip starts again
    seen = drawn(stream.folder / "seen.y4m")
    assert seen[-WHOLE:] == said[-WHOLE:]
    assert "-conceal" in options or seen == said[1:]  # the first picture created the item


def test_a_wrong_count_is_found(stream: Stream, clip: pathlib.Path) -> None:
    """Proves that the check can fail: without patience, reordered packets are counted as lost; also for the sums."""
    did, _, packets, _, _ = through_relay(stream, clip, "h264", ["drop=5", "duplicate=5"])
    assert disagreements(did, packets) == []
    for name in ("lost", "duplicate", "used", "received", "garbage"):
        assert disagreements(did, {**packets, name: packets[name] + 1})


@pytest.mark.parametrize("codec", ["h264", "mpeg4"])
def test_a_restarted_sender_is_followed(stream: Stream, short: pathlib.Path, codec: str) -> None:
    """A new sender has another SSRC and other numbers; ddxdecode goes on with its first frame."""
    decode, total = stream.decode(), 0
    for number, kill in enumerate([signal.SIGKILL, signal.SIGTERM, signal.SIGTERM]):
        sender = stream.send("-codec", codec)
        stream.play(short, "-rate", "0.5", "-instance", f"load{number}")
        wait_until(lambda: stream.packets("ddxdecode")["used"] == total + stream.packets("ddxvideosend")["packets"])
        total = stream.packets("ddxdecode")["used"]
        sender.send_signal(kill)
        sender.communicate()
        time.sleep(0.5)
    (lines, packets, shown), = finish(decode)
    assert packets["sources"] == 3 and packets["lost"] == packets["foreign"] == 0
    assert shown["in"] == shown["out"]
    assert printed(lines).count(0) == 3  # the first frame of each sender


def test_quick_restart(stream: Stream, clip: pathlib.Path) -> None:
    """Without a pause, the new sender is followed once the old one has been silent for a while; nothing is lost."""
    decode = stream.decode()
    loader = stream.desk.start("ddxvideoload", clip, "-loop")
    for number in range(3):
        sender = stream.send("-instance", f"send{number}")
        wait_until(lambda: f'"send{number}","in":' in stream.desk.run("ddxctl", "stats", "--json").stdout)
        wait_until(lambda: int(stream.desk.stats(f"send{number}")["out"]) >= numbered_clip.RATE, 60)
        sender.kill()
        sender.communicate()
    loader.terminate()
    (_, packets, shown), = finish(decode)
    assert packets["sources"] == 3 and packets["lost"] == packets["foreign"] == 0
    unfinished = shown["in"] - shown["out"]
    assert unfinished == lost(shown) <= 3 and shown["out"] >= 3 * numbered_clip.RATE  # killed between two packets


@pytest.mark.parametrize("codec", ["h264", "mpeg4"])
def test_joining_late(stream: Stream, clip: pathlib.Path, codec: str) -> None:
    """After the first key frame, whole pictures come from the next entry point on."""
    sender = stream.send("-codec", codec)
    loader = stream.desk.start("ddxvideoload", clip, "-loop", "-readers", 1)
    wait_until(lambda: stream.packets("ddxvideosend").get("packets", 0) > numbered_clip.RATE, 60)
    decode = stream.decode()
    wait_until(lambda: int(stream.desk.stats("ddxdecode")["out"]) > 40, 60)
    loader.terminate()
    loader.wait()
    (_, _, sent), (lines, packets, shown) = finish(sender, decode)
    assert packets["lost"] == 0 == shown["lost"]["decode"]
    assert shown["lost"]["network"] <= 1  # the frame on its way when ddxdecode started
    assert 0 < shown["lost"]["join"] <= RECOVERY[codec]


def test_packet_counters_are_in_the_store(stream: Stream) -> None:
    stream.decode()
    names = stream.packets("ddxdecode")
    assert {"received", "used", "lost", "late", "duplicate", "reordered", "foreign", "garbage"} <= set(names)
    assert json.dumps(names)


def test_a_gap_at_the_end(stream: Stream, short: pathlib.Path) -> None:
    """Stopped while packets wait for lost ones: their frames are shown and counted."""
    decode, relay = stream.decode("-group", "none", "-reorder", "1000"), stream.relay("drop=100")
    sender = stream.send(*TO_RELAY)
    stream.play(short)
    wait_until(lambda: 0 < stream.desk.out("ddxvideosend") == stream.desk.out("ddxdecode"))
    send_signal(decode, signal.SIGSTOP)
    turn(relay, "bad")
    stream.play_frames(short, 1)
    turn(relay, "good")
    stream.play_frames(short, 1)
    (_, _, sent), = finish(sender)
    did = end_relay(relay)
    decode.terminate()
    send_signal(decode, signal.SIGCONT)
    (lines, packets, shown), = finish(decode)
    assert packets["lost"] == did["drop"] > 0 and packets["received"] == packets["used"]
    assert sent["out"] == shown["in"] == shown["out"] + lost(shown) and shown["lost"]["network"] > 0
    assert len(lines) == shown["out"]
