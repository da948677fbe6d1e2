# SPDX-License-Identifier: GPL-2.0-or-later
"""A robot with four cameras for a minute: a stereo pair and its range, a USB and an IIDC camera; all are recorded.

An emulated machine (two processors, no KVM) can handle 2 pairs a second of 320x180 with 32 disparities, 5 frames a
second of CIF from the USB camera and of 176x144 from the IIDC camera. The grabber counts frames that a camera's driver
cannot deliver, and ddxvideoSVS the pairs that it has no time for; from store to disk, no frame may be lost.
"""
import pathlib
import time

import pytest

from lib import calibration
from lib.figures import Figure
from parts.guest import guest_camera, qemu, session
from parts.guest.guest_camera import GRABBER
from parts.guest.machine import Machine
from parts.guest.session import SAVE
from parts.media import clip as default_clip, y4m
from parts.media.clip import HEIGHT, WIDTH
from parts.media.counters import Counters
from parts.media.recording import FileSystem

from . import camera, iidc

pytestmark = [pytest.mark.strict, pytest.mark.long]

SECONDS = 60
LEAST = SECONDS // 4  # frames of each item, at least
EYE, DISPARITIES, MS = (320, 180), 32, 200
UVC = f"/tmp/v4l uvc YUYV {WIDTH} {HEIGHT} {MS} /test/feed.y4m"
RANGER = "ddxvideoSVS"
SIZES = {"left": EYE, "right": EYE, "range": (EYE[0], 3 * EYE[1]), "video": (WIDTH, HEIGHT),
         "front": (iidc.WIDTH, iidc.HEIGHT)}
GRABBERS = {"left": f"{GRABBER}.left", "right": f"{GRABBER}.right", "video": GRABBER, "front": iidc.GRABBER}
SETTINGS = {
    f"{GRABBER}.left": f"camera=0\nname=left\ninput=Webcam\nsize={EYE[0]}x{EYE[1]}\nrate=2\n",
    f"{GRABBER}.right": f"camera=1\nname=right\ninput=Webcam\nsize={EYE[0]}x{EYE[1]}\nrate=2\n",
    GRABBER: "camera=2\n",
    iidc.GRABBER: f"enabled=yes\ncamera={iidc.GUID}\nname=front\nformat=MONO8\n",
    RANGER: f"enabled=yes\nleft=left\nright=right\ncalib=/test/stereo.yml\ndisparities={DISPARITIES}\n",
    SAVE: "segment=16\n", **{f"{SAVE}.{item}": f"name={item}\nsegment=16\n" for item in SIZES if item != "video"}}


def recorder(item: str) -> str:
    return SAVE if item == "video" else f"{SAVE}.{item}"


def plug(guest: qemu.Guest) -> None:
    """Plug the cameras in once their recorders run."""
    for item in SIZES:
        guest.wait_until(f"ddxctl stats --json | grep -q '\"{recorder(item)}\"'")
    guest.sh(f"/etc/init.d/S*{GRABBER} stop")
    guest_camera.vivid(guest, "n_devs=2 node_types=0x1,0x1")  # each only a camera
    for node in ("/dev/video0", "/dev/video1"):
        camera.wait_for_node(guest, True, node)
        guest_camera.control(guest, "Timestamp Source=Start of Exposure", node)  # otherwise its times are in the future
    guest.sh("modprobe -a uvcvideo vhci_hcd")
    guest.sh(f"cd /; nohup {UVC} > /tmp/uvc 2>&1 &")
    camera.wait_for_node(guest, True, "/dev/video2")
    iidc.Camera(guest, 1, ms=MS).plug()
    guest.sh(f"/etc/init.d/S*{GRABBER} start")
    for instance in [*GRABBERS.values(), RANGER]:
        camera.wait_for_frames(guest, instance=instance)


def stop(guest: qemu.Guest) -> dict[str, Counters]:
    """Stop each stage after the one before it, so that it has seen all frames; return the counters."""
    for service in (GRABBER, iidc.GRABBER):
        guest.sh(f"/etc/init.d/S*{service} stop")
    guest.wait_until(f"ddxctl stats --json | grep '\"{RANGER}\"' | grep -q '\"waiting\":0'")
    guest.sh(f"/etc/init.d/S*{RANGER} stop")
    session.stop_recorder(guest)
    return {name: session.end_counters(guest, name)
            for name in [*GRABBERS.values(), RANGER, *map(recorder, SIZES)]}


def times_in(recording: pathlib.Path, size: tuple[int, int]) -> list[int]:
    """The capture times of a recording's frames (ns of the guest's clock), read without our programs."""
    header, frames = y4m.read(recording)
    assert (header.width, header.height) == size
    found = list(frames)
    begin = found[0].start
    times = [frame.time for frame in found]
    assert begin is not None
    return [begin + time for time in times if time is not None]


def test_nothing_is_lost_on_the_way_to_the_disk(boot: qemu.Boot, work: pathlib.Path, board: Machine,
                                                record_property: Figure) -> None:
    files = iidc.files(work)
    files["stereo.yml"] = calibration.text(calibration.ideal(*EYE), EYE)
    files.update({f"{name}.conf": text for name, text in SETTINGS.items()})
    disk = camera.disk(work, board.board, default_clip.write(work / "four.y4m", 1), files)
    with boot("four-cameras", test_disk=disk, size=4 << 30, more_memory=256) as guest:
        camera.prepare(guest)
        plug(guest)
        time.sleep(SECONDS)
        counted = stop(guest)
        partition = FileSystem(guest.snapshot())
        print(*partition.lost(), sep="\n")
        for name, one in counted.items():
            record_property(name, {"in": one.frames_in, "out": one.out, **one.lost})
            assert one.frames_in == one.out + one.lost_total and not one.waiting, one
        written = {item: counted[name].out for item, name in GRABBERS.items()}
        pairs = counted[RANGER]
        if pairs.starts == 1:  # otherwise it hung for so long that ddxhealth restarted it
            assert pairs.frames_in == written["left"] + written["right"], pairs
        assert pairs.lost["store"] == pairs.lost["picture"] == 0, pairs
        written["range"] = pairs.out // 2
        captured = {}
        for item, size in SIZES.items():
            save = counted[recorder(item)]
            assert save.lost_total == 0 and save.frames_in == save.out == written[item] > LEAST, (item, save)
            captured[item] = times_in(partition.take_only(item, work / f"four-{item}.y4m"), size)
            assert len(captured[item]) == save.out and captured[item] == sorted(set(captured[item])), item
        assert all(counted[name].lost["store"] == 0 for name in GRABBERS.values())
        assert set(captured["range"]) <= set(captured["left"])
