# SPDX-License-Identifier: GPL-2.0-or-later
"""Encrypted streams: only ddxdecode with the same key shows pictures; others report why they do not."""
from __future__ import annotations

import base64
import pathlib
import re

import pytest

from parts.media import clip as numbered_clip

from .programs import Process, result, stop, wait_until
from .rtp_rules import captured
from .stream import PORT, RELAYED, TO_RELAY, Stream, finish, make_key, printed, turn

pytestmark = pytest.mark.strict

FRAMES = numbered_clip.RATE
# Receivers: port, key, and ddxdecode's message.
RECEIVERS = {"wrong": (8010, "other.key", "it is encrypted with another key than that of -key other.key"),
             "missing": (8020, "", "it is encrypted; give its key: -key FILE"),
             "plain": (8030, "stream.key", "it is not encrypted, unlike -key stream.key")}
EXPLAINED = 25  # packets until a receiver has reported why it shows nothing


@pytest.fixture
def keyed(stream: Stream) -> Stream:
    """A stream with two key files."""
    make_key(stream.folder / "stream.key")
    make_key(stream.folder / "other.key")
    return stream


def decode(stream: Stream, instance: str, port: int, key: str) -> Process:
    return stream.decode("-group", "none", "-instance", instance, "-port", port, *(("-key", key) if key else ()))


def parameter_sets(sdp: str) -> list[bytes]:
    found = re.search(r"sprop-parameter-sets=(\S+)", sdp)
    assert found
    return [base64.b64decode(word) for word in found[1].split(",")]


def test_only_a_receiver_with_the_key_shows_pictures(keyed: Stream, clip: pathlib.Path) -> None:
    """One sender with a key and several receivers, and one sender without a key."""
    show = decode(keyed, "right", PORT, "stream.key")
    others = {name: decode(keyed, name, port, key) for name, (port, key, _) in RECEIVERS.items()}
    relay = keyed.relay("copy=packets")
    to = ",".join(f"127.0.0.1:{port}" for port in [RELAYED, RECEIVERS["wrong"][0], RECEIVERS["missing"][0]])
    sender = keyed.send("-group", "none", "-to", to, "-key", "stream.key", "-sdp", "stream.sdp")
    plain = keyed.send("-instance", "open", "-port", 8100, "-group", "none", "-to",
                       f"127.0.0.1:{RECEIVERS['plain'][0]}", "-sdp", "open.sdp")
    loader = keyed.desk.start("ddxvideoload", clip, "-loop", "-readers", 2)
    for name in others:
        wait_until(lambda name=name: keyed.packets(name).get("refused", 0) > EXPLAINED)  # type: ignore[misc]
    wait_until(lambda: keyed.packets("right").get("received", 0) > EXPLAINED)
    assert stop(loader)[0] == 0
    (_, sent_packets, sent), _ = finish(sender, plain)
    relay.terminate()
    assert result(relay)[0] == 0
    # The receiver with the key shows all, and received all packets.
    (lines, packets, shown), = finish(show)
    assert shown["in"] == shown["out"] == sent["out"] == len(printed(lines)) and sum(shown["lost"].values()) == 0
    assert packets["refused"] == packets["repeated"] == packets["garbage"] == 0 and packets["received"] > EXPLAINED
    assert packets["reports"] >= sent_packets["reports"] > sent_packets["reports_unused"]
    # All others show nothing, and report why once.
    for name, process in others.items():
        said = keyed.desk.errors(process)
        (lines, packets, counters), = finish(process)
        assert printed(lines) == [] and counters["in"] == counters["out"] == packets["received"] == 0
        assert packets["reports"] == packets["reports_lost"] == 0
        assert packets["refused"] > EXPLAINED and said.count("nothing is shown of SSRC") == 1
        assert RECEIVERS[name][2] in said
    # Only headers are readable on the wire; the description has the key, and only its owner can read it.
    description = (keyed.folder / "stream.sdp").read_text()
    assert (keyed.folder / "stream.sdp").stat().st_mode & 0o777 == 0o600
    assert " RTP/SAVP 96\n" in description
    key = (keyed.folder / "stream.key").read_text().strip()
    assert f"a=crypto:1 AES_CM_128_HMAC_SHA1_80 inline:{key}\n" in description
    kept = captured(keyed.folder / "packets")
    sets = parameter_sets(description)
    assert len(kept) > EXPLAINED and not any(one in packet for packet in kept for one in sets)
    assert " RTP/AVP 96\n" in (keyed.folder / "open.sdp").read_text()


def test_lost_and_changed_packets_are_restored(keyed: Stream, clip: pathlib.Path) -> None:
    """A packet changed on its way is refused, and restored like a lost one."""
    show = decode(keyed, "ddxdecode", PORT, "stream.key")
    relay, repair = keyed.relay("drop=15", "damage=15"), keyed.relay(offset=2)
    sender = keyed.send("-key", "stream.key", *TO_RELAY)
    loader = keyed.desk.start("ddxvideoload", clip, "-loop", "-readers", "1")
    wait_until(lambda: keyed.desk.out("ddxdecode") > 0)
    turn(relay, "bad")
    wait_until(lambda: keyed.packets("ddxdecode").get("restored", 0) > 10)
    turn(relay, "good")
    assert stop(loader)[0] == 0
    wait_until(lambda: keyed.desk.out("ddxdecode") == keyed.desk.out("ddxvideosend"))
    (_, _, sent), (lines, packets, shown) = finish(sender, show)
    for one in (relay, repair):
        one.terminate()
    did = result(relay)[1]
    assert did["drop"] > 2 and packets["refused"] == did["damage"] > 2 and packets["lost"] == 0
    assert shown["in"] == shown["out"] == sent["out"] == len(lines)
    assert "nothing is shown" not in keyed.desk.errors(show)


def test_invalid_keys_are_refused(keyed: Stream) -> None:
    make_key(keyed.folder / "open.key", 0o644)
    (keyed.folder / "empty.key").touch(0o600)
    (keyed.folder / "link.key").symlink_to("stream.key")
    for program in ("ddxvideosend", "ddxdecode"):
        for name in ("open.key", "empty.key", "link.key", "absent.key"):
            done = keyed.desk.run(program, "-key", name)
            assert done.returncode == 2 and done.stderr.startswith(f"{program}: -key {name}: ")
            assert done.stderr.count("\n") == 1
    done = keyed.desk.run("ddxvideosend", "-key", "stream.key", "-ts", 8100)
    assert done.returncode == 2 and "-ts 8100: MPEG-TS is not encrypted" in done.stderr
