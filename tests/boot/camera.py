# SPDX-License-Identifier: GPL-2.0-or-later
"""Cameras for the boot tests: vivid in a guest, the grabber's settings, the frames that it published."""
import dataclasses
import json
import pathlib
import struct
import time
from collections.abc import Callable, Iterable
from typing import Any

from lib.figures import uptime
from parts.common import PATIENCE, Failed
from parts.guest.guest_camera import GRABBER, control, disk, loop, prepare, vivid
from parts.guest.qemu import Guest
from parts.media import counters, y4m
from parts.media.clip import HEIGHT, WIDTH, frame_number
from parts.media.counters import Counters


KEEP = 64  # frames that a reader may lag behind
MS = 100  # between frames of the USB camera
UVC = f"/tmp/v4l uvc {{format}} {WIDTH} {HEIGHT} {MS} /test/{{file}}"

__all__ = ["GRABBER", "control", "disk", "loop", "prepare", "vivid"]  # re-exported for the tests

def wait_for_node(guest: Guest, there: bool, node: str = "/dev/video0") -> float:
    """Wait until the device is there and owned by the grabber's user, or is gone; return the guest's uptime in s."""
    is_there = f'[ "$(stat -c %U {node} 2> /dev/null)" = ddxgrab ]' if there else f"! [ -c {node} ]"
    guest.wait_until(is_there, pause=0.05)
    return uptime(guest)


def plug(guest: Guest, form: str = "YUYV") -> float:
    """Plug the camera in; return the guest's uptime (s) when its device was there."""
    command = UVC.format(format=form, file="feed.mjpeg" if form == "MJPG" else "feed.y4m")
    guest.sh(f"cd /; nohup {command} > /tmp/uvc 2>&1 &")
    return wait_for_node(guest, True)


def unplug(guest: Guest) -> str:
    guest.sh("killall v4l")
    guest.wait_until("! pidof v4l > /dev/null", pause=0.05)
    wait_for_node(guest, False)
    return guest.sh("cat /tmp/uvc")


def configure(guest: Guest, text: str, instance: str = GRABBER) -> None:
    """Write an instance's settings as a technician does; the service restarts with them."""
    guest.sh(f"printf '%s\\n' {' '.join(repr(word) for word in text.split())} > /data/ddx/{instance}.conf")
    guest.sh(f"/etc/init.d/S*{GRABBER} restart")


def driver_controls(guest: Guest, device: str = "/dev/video0") -> dict[str, int]:
    """Each of the driver's controls and its value, as the driver reports them."""
    lines = guest.sh(f"/tmp/v4l control {device}").splitlines()
    return {name: int(value) for name, value in (line.rsplit("=", 1) for line in lines)}


def log(guest: Guest, instance: str = GRABBER) -> str:
    return guest.sh(f"cat /run/log/{instance}/current")


def stats(guest: Guest, instance: str = GRABBER) -> Counters:
    found = counters.of(instance, guest.sh("ddxctl stats --json"))
    if not found:
        raise Failed(f"no counters of {instance}")
    return found[0]


def wait_for_frames(guest: Guest, frames: int = 1, instance: str = GRABBER, seconds: float = PATIENCE) -> Counters:
    """Wait until the grabber has put that many more frames into the store."""
    deadline = time.monotonic() + seconds
    begin = None
    while True:
        try:
            now = stats(guest, instance)
        except Failed:
            now = Counters()
        begin = now.out if begin is None else begin
        if now.out >= begin + frames:
            return now
        if time.monotonic() > deadline:
            raise Failed(f"{instance}: {now}\n{log(guest, instance)}")
        time.sleep(0.5)


def checksum(picture: bytes, width: int, height: int) -> int:
    """The checksum that tests/guest/frames prints: FNV-1a over the eight-byte words of each plane."""
    luma = width * height
    return checksum_of_planes([picture[:luma], picture[luma:luma // 4 * 5], picture[luma // 4 * 5:luma // 2 * 3]])


def checksum_of_planes(planes: Iterable[bytes]) -> int:
    total = 14695981039346656037
    for plane in planes:
        for word in struct.unpack(f"<{len(plane) // 8}Q", plane[:len(plane) // 8 * 8]):
            total = (total ^ word) * 1099511628211 & 0xffffffffffffffff
    return total


def checksums(pictures: Iterable[bytes], width: int, height: int) -> list[int]:
    return [checksum(picture, width, height) for picture in pictures]


def numbers(path: pathlib.Path) -> list[int | None]:
    header, frames = y4m.read(path)
    return [frame_number(frame.data, header.width, header.height) for frame in frames]


@dataclasses.dataclass
class Frame:
    """One frame as a reader of the store sees it; times in ns."""
    number: int
    sequence: int
    source_lost: int
    time: int
    published: int
    fields: int
    width: int
    height: int
    missed: int
    checksum: int


def value(guest: Guest, item: str) -> dict[str, Any]:
    """The item's newest value."""
    return dict(json.loads(guest.sh(f"ddxctl show {item} --json"))["value"])


class Reader:
    """Records every frame of an item in the background."""

    def __init__(self, guest: Guest, seconds: float, item: str = "video", keep: int = KEEP) -> None:
        self.guest, self.file = guest, f"/tmp/frames.{item}"
        guest.sh(f"rm -f {self.file}; nohup /tmp/frames {item} {seconds} {keep} > {self.file} 2>&1 & "
                 f"echo $! > {self.file}.pid")
        if f'"{item}"' in guest.sh("ddxctl list --json"):  # otherwise it waits for the item, and may open it late
            guest.wait_until(f"grep -q ready {self.file}")

    def stop(self) -> list[Frame]:
        """Return all frames published by now."""
        pid = self.guest.sh(f"read -r pid < {self.file}.pid; kill $pid 2> /dev/null; echo $pid")
        self.guest.wait_until(f"! [ -d /proc/{pid} ]", pause=0.1)
        return [Frame(*(int(word, 0) for word in line.split()))
                for line in self.guest.sh(f"cat {self.file}").splitlines() if line != "ready"]


def changes(frames: list[Frame]) -> list[int]:
    """The pictures' checksums, without repetitions."""
    return [frame.checksum for index, frame in enumerate(frames)
            if index == 0 or frame.checksum != frames[index - 1].checksum]


def shows(frames: list[Frame], wanted: list[int]) -> bool:
    """Whether the wanted pictures came, bit-exact and in this order. A few may be missing: each is shown for a fixed
    time, and a host that stalls may let one pass unseen."""
    seen, due = changes(frames), iter(wanted)
    return all(one in due for one in seen) and len(seen) >= len(wanted) // 2


def gaps(frames: list[Frame]) -> int:
    """The count of frame numbers missing in the driver's sequence, except where numbering restarts."""
    steps = [(after.sequence - before.sequence) % 2**32 for before, after in zip(frames, frames[1:])]
    return sum(step - 1 for step in steps if 0 < step < 2**31)


@dataclasses.dataclass
class Run:
    """One run of the grabber: every frame that a reader saw, and the change of the counters."""
    frames: list[Frame]
    counters: Counters

    @property
    def wrong(self) -> list[str]:
        """Violations of: in = out + lost, and a reader has seen every frame that went out."""
        counters, found = self.counters, []
        if counters.waiting or counters.frames_in != counters.out + counters.lost_total:
            found.append(f"does not add up: {counters}")
        if counters.out != len(self.frames):
            found.append(f"{counters.out} frames went out, {len(self.frames)} were seen")
        if missed := sum(frame.missed for frame in self.frames):
            found.append(f"the reader missed {missed}")
        return found


def _difference(after: Counters, before: Counters) -> Counters:
    lost = {reason: count - before.lost.get(reason, 0) for reason, count in after.lost.items()}
    return Counters(after.instance, after.frames_in - before.frames_in, after.out - before.out, after.waiting, lost,
                    after.latency, after.first_ns, after.starts - before.starts, after.skipped - before.skipped)


def run_grabber(guest: Guest, settings: str, seconds: float, meanwhile: Callable[[], None] = lambda: None,
                keep: int = KEEP) -> Run:
    """Start the grabber, call `meanwhile`, and stop it `seconds` or more after its first frames."""
    if '"video"' not in guest.sh("ddxctl list --json"):
        configure(guest, settings)
        wait_for_frames(guest)
    guest.sh(f"/etc/init.d/S*{GRABBER} stop")
    before = stats(guest)
    reader = Reader(guest, 600, keep=keep)
    configure(guest, settings)
    wait_for_frames(guest, 5)
    begin = time.monotonic()
    meanwhile()
    time.sleep(max(0.0, begin + seconds - time.monotonic()))
    guest.sh(f"/etc/init.d/S*{GRABBER} stop")
    after = stats(guest)
    return Run(reader.stop(), _difference(after, before))


def said(guest: Guest) -> list[str]:
    """The last run's messages without name and time, except those about single frames."""
    text = [line.split(" ", 1)[1] for line in log(guest).splitlines() if " " in line]
    ends = [index for index, line in enumerate(text[:-1]) if line.startswith("{")]  # counters are printed last
    return [line.removeprefix(f"{GRABBER}: ") for line in text[ends[-1] + 1 if ends else 0:]
            if not line.startswith("{") and "the driver lost" not in line]
