# SPDX-License-Identifier: GPL-2.0-or-later
"""The source of a run's frames: a clip that the loader replays, or a camera (vivid) that is shown a clip."""
import pathlib
import time
from collections.abc import Callable, Mapping

from parts.common import Failed
from parts.guest import camera_run, guest_camera, session, testdisk
from parts.guest.guest_camera import GRABBER
from parts.guest.qemu import Guest
from parts.guest.session import LOAD, Result, Show
from parts.media import y4m
from parts.media.counters import Counters

SHOWN_MS = 200     # time of a clip's frame before the camera, whose own frames take 40 ms
GROWS = 1 << 30    # bytes that the disk is larger than the image, for both recordings of a minute in /rec


class Source:
    """The common part: the clip and its number of frames."""

    def __init__(self, clip: pathlib.Path) -> None:
        self.clip = clip
        self.header, frames = y4m.read(clip)
        self.frames = sum(1 for _ in frames)


class Clip(Source):
    """Plays each frame of the clip once, at its time, after the recorder and the sender have started."""
    grabber = LOAD
    size = 0

    def __init__(self, clip: pathlib.Path) -> None:
        super().__init__(clip)
        first, second = (self.header.value("F") or "25:1").split(":")
        self.rate = 25.0 if "0" in (first, second) else int(first) / int(second)  # as the loader
        self.more_memory = testdisk.more_memory(clip)

    def disk(self, work: pathlib.Path, board: str, settings: Mapping[str, str]) -> pathlib.Path:
        return testdisk.make(work / "test.img", self.clip, {"ddxvideoload.conf": "readers=2\n", **settings})

    def play(self, guest: Guest, show: Show | None = None) -> None:
        """Wait until the last frame is in the store."""
        session.wait_for_clip(guest, self.frames, show, self.rate)

    def judge(self, recording: pathlib.Path, source: Counters, save: Counters) -> Result:
        return session.judge(self.clip, recording, source, save)


class Vivid(Source):
    """Shows the clip on vivid's output, looped to its input, SHOWN_MS for each frame; ddxvideoV4L captures it."""
    grabber = GRABBER
    size = GROWS
    more_memory = 0

    def __init__(self, clip: pathlib.Path) -> None:
        super().__init__(clip)
        if (self.header.width, self.header.height) != (352, 288):
            raise Failed(f"{clip.name}: the camera is shown CIF, 352x288, not {self.header.width}x{self.header.height}")
        self.times: list[int] = []  # ms of the guest's clock when each frame appeared; filled by play()

    def disk(self, work: pathlib.Path, board: str, settings: Mapping[str, str]) -> pathlib.Path:
        return guest_camera.disk(work, board, self.clip, {f"{GRABBER}.conf": guest_camera.LOOPED, **settings})

    def play(self, guest: Guest, show: Show | None = None, meanwhile: Callable[[], None] = lambda: None) -> None:
        """Run from the camera's first frame to its last one, so that the recordings contain only the clip. `meanwhile`
        is called when the clip continues."""
        guest_camera.prepare(guest)
        guest.sh(f"/etc/init.d/S*{GRABBER} stop")
        guest_camera.vivid(guest)
        guest_camera.loop(guest, SHOWN_MS)
        guest.sh(f"/etc/init.d/S*{GRABBER} start")
        begin = time.monotonic()
        limit = 120 + 3 * self.frames * SHOWN_MS / 1000
        started = False
        while True:
            seen = session.follow(guest, time.monotonic() - begin, show)
            if not started and all(name in seen and seen[name].out > 10 for name in (GRABBER, session.SAVE)):
                guest.sh("touch /tmp/feed/go")
                started = True
                meanwhile()
            if "shown" in guest.sh("cat /tmp/feed/log"):
                break
            if time.monotonic() - begin > limit:
                raise Failed(f"the clip was not shown within {limit:.0f} s: {seen}\n"
                             + guest.sh(f"cat /run/log/{GRABBER}/current /tmp/feed/log"))
            time.sleep(1)
        guest.sh(f"/etc/init.d/S*{GRABBER} stop")
        self.times = [int(line) for line in guest.sh("cat /tmp/feed/times").split()]

    def judge(self, recording: pathlib.Path, source: Counters, save: Counters) -> Result:
        return camera_run.judge(self.clip, recording, source, save, self.times)


SOURCES: dict[str, type[Clip] | type[Vivid]] = {"clip": Clip, "vivid": Vivid}
