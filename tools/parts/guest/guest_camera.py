# SPDX-License-Identifier: GPL-2.0-or-later
"""A camera inside a guest: vivid, the kernel's test camera, and the programs of tests/guest that feed it."""
import pathlib
from collections.abc import Mapping

from parts.common import TOP, run
from parts.guest import guest_program, testdisk
from parts.guest.qemu import Guest
from parts.image import dc1394, native, srtp

GRABBER = "ddxvideoV4L"
FEED = "feed.y4m"   # on the test disk: a clip that no service replays
INTERLACED = 4      # V4L2_FIELD_INTERLACED
LOOPED = "input=S-Video\nstandard=PAL\nsize=CIF\nformat=YU12\n"  # settings of the grabber for loop()
SANITIZE = ["-std=gnu11", "-g", "-O1", "-fsanitize=address,undefined", "-fno-omit-frame-pointer"]


def programs(work: pathlib.Path, board: str) -> dict[str, pathlib.Path]:
    """Build what feeds and judges the camera; `frames` contains libddx."""
    # With a declared type, a lookup would refuse items of other layouts than 4:2:0.
    more: dict[str, list[str]] = {"v4l": [], "frames": ["-DDDXVIDEO_UNDECLARED=", *native.static_library()]}
    return {name: guest_program.build(name, work, board, words) for name, words in more.items()}


def sanitized_1394(work: pathlib.Path) -> pathlib.Path:
    """Build ddxvideo1394 and libdc1394 with AddressSanitizer for the development image: one program from our sources,
    with static sanitizers, and with the image's libusb and FFmpeg."""
    program, library = work / "sanitized1394", dc1394.dc1394("-g -O1 -fsanitize=address -fno-omit-frame-pointer")
    ddx, video = TOP / "package/ddx", TOP / "package/ddxvideo"
    folders = [ddx / "lib", ddx / "program", video / "common", video / "grab", video / "grab/iidc"]
    sources = [path for folder in folders for path in sorted(folder.glob("*.c")) if path.name != "fault.c"]
    include = [ddx / "include", ddx / "program", video / "include", video / "common", video / "grab",
               library / "usr/include"]
    run(["gcc", *SANITIZE, "-static-libasan", "-static-libubsan", "-static-libgcc", "-D_GNU_SOURCE",
         "-DDDXVIDEO_UNDECLARED", '-DDDX_VERSION="sanitized"', *(f"-I{folder}" for folder in include), *sources,
         "-o", program, library / srtp.LIBRARIES / "libdc1394.a", "-lusb-1.0", "-lavcodec", "-lswscale", "-lavutil",
         "-lpthread", "-lm"])
    return program


def disk(work: pathlib.Path, board: str, clip: pathlib.Path,
         more: Mapping[str, pathlib.Path | str] | None = None) -> pathlib.Path:
    """A test disk with the programs that feed a camera, and other files, such as settings."""
    files: dict[str, pathlib.Path | str] = {**programs(work, board), FEED: clip, **(more or {})}
    return testdisk.make(work / f"camera-{clip.stem}.img", None, files)


def prepare(guest: Guest) -> None:
    guest.shell()
    guest.sh("mkdir -p /tmp/feed && cp /test/v4l /test/frames /tmp && chmod 755 /tmp/v4l /tmp/frames")


def vivid(guest: Guest, options: str = "") -> None:
    """Load vivid; devices 0 and 1 of each instance are its input and its output."""
    guest.sh(f"modprobe vivid no_error_inj=0 {options}")
    guest.wait_until("[ -c /dev/video0 ]")


def control(guest: Guest, what: str, device: str = "/dev/video0") -> None:
    """Set one of the driver's controls, without the program under test: "Brightness=100"."""
    guest.sh(f"/tmp/v4l control {device} {what!r}")


def loop(guest: Guest, milliseconds: int, fourcc: str = "YU12") -> None:
    """Show the feed's first frame on vivid's output, connected to the S-Video input. The clip continues, with this time
    for each frame, when /tmp/feed/go exists; the last frame stays until /tmp/feed/end exists."""
    control(guest, "OSD Text Mode=None")
    control(guest, "Timestamp Source=Start of Exposure")  # its other times are in the future
    guest.sh("rm -f /tmp/feed/*; cd /; nohup /tmp/v4l feed /dev/video1 0 "
             f"{fourcc} {INTERLACED} {milliseconds} /test/{FEED} /tmp/feed > /tmp/feed/log 2>&1 & sleep 1")
    control(guest, "S-Video 000-0 Is Connected To=Output S-Video")
