# SPDX-License-Identifier: GPL-2.0-or-later
"""A robot and an operator run the same image; the network between them loses 30 % of the packets in both directions."""
import dataclasses
import json
import pathlib
import tempfile
import time

import pytest

from lib.figures import Figure
from parts.guest import qemu, session, stream, testdisk
from parts.guest.qemu import Guest
from parts.media import clip as default_clip
from parts.media.recording import FileSystem

from . import camera
from .segment import MEDIA, REPAIR, REPORTS, Segment

pytestmark = [pytest.mark.retry, pytest.mark.long]

SEED, LOST, DOUBLED = "17", 0.3, 0.1
QUIET, BAD = 2, 10  # s of the clip's 20 with a good network, then with a bad one
END = 3  # s later the pictures are right again, after MPEG-4's next key frame
SHOWN = 0.9  # share of the frames sent; reports of emulated machines are late


def network(guest: Guest, address: str) -> None:
    guest.sh(f"ip link set eth0 up && ip addr add {address}/24 dev eth0")


def service(guest: Guest, program: str, settings: str, instance: str = "") -> None:
    """Switch a service on as a technician does."""
    guest.sh(f"printf '{settings}' > /data/ddx/{program}{instance}.conf; /etc/init.d/S*{program} start")


def packets(guest: Guest, instance: str) -> dict[str, int]:
    return dict(json.loads(guest.sh(f"ddxctl show {instance}.packets --json"))["value"])


def delivered(segment: Segment, port: int) -> int:
    return segment.flow(port).delivered


def arrive(operator: Guest, segment: Segment) -> None:
    """Wait until packets on their way have reached ddxdecode's counters, which are written once a second; packets that
    do not arrive in time show up as missing."""
    end = time.monotonic() + 20
    while time.monotonic() < end:
        found = packets(operator, stream.DECODE)
        if found["received"] >= delivered(segment, MEDIA) and found["repair_received"] >= delivered(segment, REPAIR):
            break
        time.sleep(1)


def disagreements(segment: Segment, sent: dict[str, int], received: dict[str, int]) -> list[str]:
    """Counters at both ends that differ from the relay's."""
    media, repair, reports = map(segment.flow, (MEDIA, REPAIR, REPORTS))
    # A packet restored before ddxdecode reads it from the other socket counts as a duplicate.
    early = received["duplicate"] - media.doubled
    never = received["lost"] - received["late"] + received["restored"] - early
    known = ("restored", "repair_useless", "repair_expired", "repair_refused", "repair_corrupt")
    both = {"media packets sent": (sent["media"], media.packets),
            "repair packets sent": (sent["repairs"], repair.packets),
            "packets sent": (sent["packets"], media.packets + repair.packets),
            "media packets received": (received["received"], media.delivered),
            "repair packets received": (received["repair_received"], repair.delivered),
            "reports sent": (received["reports"], reports.packets),
            "reports received": (sent["reports"], reports.delivered),
            "lost, restored, and not restored too early": (never, media.lost),
            "uses of repair packets": (sum(received[name] for name in known), repair.delivered),
            "garbage and foreign": (received["garbage"] + received["foreign"], 0),
            "duplicates": (min(early, 0), 0),
            "forged": (received["repair_refused"] + received["repair_corrupt"] + received["repair_wrong"], 0)}
    return [f"{what}: {ours} and {theirs}" for what, (ours, theirs) in both.items() if ours != theirs]


def test_a_stream_through_a_lossy_network(boot: qemu.Boot, work: pathlib.Path, clip: pathlib.Path,
                                        record_property: Figure) -> None:
    disk = testdisk.make(work / "robot.img", clip, {"ddxvideoload.conf": "readers=2\n"})
    with tempfile.TemporaryDirectory(prefix="ddx-") as folder:
        segment = Segment(pathlib.Path(folder), SEED, LOST, DOUBLED)
        with boot("operator", extra=segment.card(1)) as operator, \
                boot("robot", test_disk=disk, extra=segment.card(0)) as robot:
            network(operator, "10.0.0.2")
            service(operator, "ddxvideosave", "name=seen\\n", ".seen")
            service(operator, "ddxdecode", "enabled=yes\\ninterface=eth0\\n")
            operator.wait_until("cat /proc/net/udp* | grep -q ':1F40 '")  # port 8000 is open before anything is sent
            network(robot, "10.0.0.1")
            service(robot, "ddxvideosend", "enabled=yes\\ncodec=mpeg4\\ninterface=eth0\\n")
            mended = watch(robot, segment)
            robot.sh("/etc/init.d/S*ddxvideosend stop")
            sent = packets(robot, stream.SEND)
            arrive(operator, segment)
            operator.sh("/etc/init.d/S*ddxdecode stop")
            received = packets(operator, stream.DECODE)
            session.stop_recorder(operator)
            ends = {one: session.end_counters(operator, one) for one in (stream.DECODE, stream.RECORDER)}
            FileSystem(operator.snapshot()).take_only(stream.ITEM, work / "two-shown.y4m")
            ends[stream.SEND] = session.end_counters(robot, stream.SEND)
            session.stop_recorder(robot)
            result = session.collect(robot, clip, work / "two-recorded.y4m")
        segment.end()
    flows = {"media": segment.flow(MEDIA), "repair": segment.flow(REPAIR), "reports": segment.flow(REPORTS)}
    record_property("network", {name: dataclasses.asdict(flow) for name, flow in flows.items()})
    record_property("decode_packets", received)
    assert result.good, result.disagreements  # the robot is not affected
    assert all(flow.lost > 10 and flow.doubled > 3 for flow in flows.values())
    assert disagreements(segment, sent, received) == []
    assert received["restored"] > 0.8 * flows["media"].lost

    seen = stream.judge(work / "two-shown.y4m", work / "two-recorded.y4m", ends[stream.SEND], ends[stream.DECODE],
                        ends[stream.RECORDER])
    assert seen.disagreements == []
    right = [one.time for index, one in enumerate(seen.shown) if index not in seen.wrong]
    quiet = [one.time for one in seen.shown if one.time < (QUIET - 1) * 1e9 or one.time > (mended + END) * 1e9]
    assert seen.shown[-1].time > (mended + END) * 1e9 and set(quiet) <= set(right)
    record_property("pictures", {"shown": len(seen.shown), "lost": seen.lost_decode})
    assert seen.wrong == [] and len(seen.shown) >= SHOWN * ends[stream.SEND].out


def watch(robot: Guest, segment: Segment) -> float:
    """Wait until the clip has played, with a bad network in its middle; return the second when it was good again."""
    camera.wait_for_frames(robot, 25 * QUIET, session.LOAD)
    segment.turn(bad=True)
    camera.wait_for_frames(robot, 25 * BAD, session.LOAD)
    segment.turn(bad=False)
    mended = camera.stats(robot, session.LOAD).out / default_clip.RATE
    session.wait_for_clip(robot, 500)
    time.sleep(1)
    return mended
