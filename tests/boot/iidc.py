# SPDX-License-Identifier: GPL-2.0-or-later
"""IIDC cameras for the boot tests: tests/guest/v4l as a USB camera, its pictures, and the expected results."""
import contextlib
import dataclasses
import pathlib
import subprocess
from collections.abc import Iterator, Mapping

import numpy
from numpy.typing import NDArray

from parts.common import Failed
from parts.guest import qemu
from parts.guest.machine import Machine
from parts.guest.qemu import Guest
from parts.media import clip as default_clip
from parts.media import counters
from parts.media.counters import Counters

from . import camera

GRABBER, USER = "ddxvideo1394", "ddx1394"
GUID = "00b09d0100abcdef"
WIDTH, HEIGHT, FRAMES = 176, 144, 8
MS = 40
# The coding's number in the registers, bytes per two pixels, FFmpeg's name for the planes of unpacked().
CODINGS = {"MONO8": (0, 2, "gray"), "YUV411": (1, 3, "yuv411p"), "YUV422": (2, 4, "uyvy422"),
           "YUV444": (3, 6, "yuv444p"), "RGB8": (4, 6, "rgb24"), "MONO16": (5, 4, "gray"), "RGB16": (6, 12, "rgb24"),
           "RAW8": (9, 2, "bayer_grbg8"), "RAW16": (10, 4, "bayer_grbg8")}
LAYOUTS = {"RGB24": "RGB8", "YUV422P": "YUV422"}  # layout: the coding with the same samples
TWO_BYTES = ("MONO16", "RGB16", "RAW16")

Picture = NDArray[numpy.uint8]


def sent(coding: str, number: int) -> Picture:
    """A frame as the camera sends it, one row of bytes per row: noise, but constant chroma, which no filter changes."""
    numeral, bytes_of_two, _ = CODINGS[coding]
    random = numpy.random.default_rng([numeral, number])
    frame = random.integers(0, 256, (HEIGHT, WIDTH * bytes_of_two // 2), numpy.uint8)
    if coding.startswith("YUV"):
        group = {"YUV411": 6, "YUV422": 4, "YUV444": 3}[coding]
        second = {"YUV411": 3, "YUV422": 2, "YUV444": 2}[coding]
        frame[:, 0::group], frame[:, second::group] = 40 + 10 * number, 220 - 10 * number
    return frame


def marked(coding: str, frame: Picture) -> Picture:
    """The frame after the grabber has removed the counter from its first bytes."""
    if coding in TWO_BYTES:
        return frame
    frame = frame.copy()
    frame[0, :4] = frame[2, :4]
    return frame


def unpacked(coding: str, frame: Picture) -> bytes:
    """The frame as planes that FFmpeg reads."""
    if coding in TWO_BYTES:
        return frame[:, 0::2].tobytes()
    if coding == "YUV411":
        groups = frame.reshape(HEIGHT, WIDTH // 4, 6)
        return groups[:, :, [1, 2, 4, 5]].tobytes() + groups[:, :, 0].tobytes() + groups[:, :, 3].tobytes()
    if coding == "YUV444":
        pixels = frame.reshape(HEIGHT, WIDTH, 3)
        return b"".join(pixels[:, :, plane].tobytes() for plane in (1, 0, 2))
    return frame.tobytes()


def expected(coding: str, counted: bool) -> list[int]:
    """Checksums of the pictures in the store."""
    frames = [sent(coding, number) for number in range(FRAMES)]
    raw = [unpacked(coding, marked(coding, frame) if counted else frame) for frame in frames]
    form = CODINGS[coding][2]
    if form == "gray":
        pictures = [luma + bytes([128]) * (WIDTH * HEIGHT // 2) for luma in raw]
    else:
        rgb = "format=rgb24," if form.startswith("bayer") else ""  # the same conversion path in all versions of FFmpeg
        scale = f"{rgb}scale={WIDTH}:{HEIGHT}:flags=bilinear+accurate_rnd"
        done = subprocess.run(
            ["ffmpeg", "-v", "error", "-filter_threads", "1", "-f", "rawvideo", "-pix_fmt", form, "-s",
             f"{WIDTH}x{HEIGHT}", "-i", "-", "-vf", scale, "-pix_fmt", "yuv420p", "-f", "rawvideo", "-"],
            input=b"".join(raw), stdout=subprocess.PIPE, check=True, timeout=60).stdout
        size = WIDTH * HEIGHT * 3 // 2
        pictures = [done[at:at + size] for at in range(0, len(done), size)]
    return camera.checksums(pictures, WIDTH, HEIGHT)


def in_layout(layout: str, number: int) -> list[bytes]:
    """The planes expected in the store for a layout that takes the camera's samples unchanged."""
    frame = marked(LAYOUTS[layout], sent(LAYOUTS[layout], number))
    if layout == "RGB24":
        return [frame.tobytes()]
    return [frame[:, begin::step].tobytes() for begin, step in [(1, 2), (0, 4), (2, 4)]]


def files(work: pathlib.Path) -> dict[str, pathlib.Path | str]:
    """The camera's files for the test disk."""
    found: dict[str, pathlib.Path | str] = {}
    for coding, (numeral, _, _) in CODINGS.items():
        path = work / f"iidc.{numeral}"
        path.write_bytes(b"".join(sent(coding, number).tobytes() for number in range(FRAMES)))
        found[path.name] = path
    return found


@contextlib.contextmanager
def booted(boot: qemu.Boot, work: pathlib.Path, board: Machine, name: str,
           more: Mapping[str, pathlib.Path | str] | None = None) -> Iterator[Guest]:
    """A guest without other grabbers and recorders; `more`: further files for its test disk."""
    clip = work / "iidc.y4m"
    default_clip.write(clip, 1)
    disk = camera.disk(work, board.board, clip, {**files(work), **(more or {})})
    with boot(name, test_disk=disk, more_memory=128) as guest:
        camera.prepare(guest)
        guest.sh("for name in ddxvideosave ddxvideoV4L; do /etc/init.d/S*$name stop; done; "
                 "modprobe -a uvcvideo vhci_hcd")
        yield guest


def end(guest: Guest, file: str) -> None:
    """Kill the process whose number is in the file. Each check is a separate command, so that the shell reaps it."""
    pid = guest.sh(f"read -r pid < {file}; kill $pid; echo $pid")
    guest.wait_until(f"! [ -d /proc/{pid} ]", pause=0.05)


def in_kernel(number: object) -> str:
    """The kernel's folder of the camera at a port; ports count from 1. Plug in no camera before the folder is gone:
    vhci_hcd leaves the port enabled after an unplug, so the kernel takes the next camera for the same one, cancels
    transfers that it does not know, and waits forever for its answer."""
    return f"/sys/devices/platform/vhci_hcd.0/usb*/*-{number}"


@dataclasses.dataclass
class Camera:
    """A camera that is plugged in from plug() to unplug()."""
    guest: Guest
    port: int = 0
    guid: str = GUID
    options: str = "counter bayer"
    ms: int = MS

    def plug(self) -> None:
        self.guest.sh(f"cd /; [ -p /tmp/words{self.port} ] || mkfifo /tmp/words{self.port}; "
                      f"nohup /tmp/v4l iidc {self.port} {self.guid} {WIDTH} {HEIGHT} {self.ms} /test/iidc "
                      f"{self.options} <> /tmp/words{self.port} > /tmp/iidc{self.port} 2>&1 & "
                      f"echo $! > /tmp/iidc{self.port}.pid")

    def command(self, word: str, times: int = 1) -> None:
        """Send the word that number of times; wait each time until the camera has obeyed."""
        for _ in range(times):
            before = self.guest.sh(f"grep -cx 'done {word}' /tmp/iidc{self.port} || :")
            self.guest.sh(f"echo {word} > /tmp/words{self.port}")
            self.guest.wait_until(f"[ $(grep -cx 'done {word}' /tmp/iidc{self.port}) -gt {before} ]", pause=0.02)

    def unplug(self) -> str:
        """Unplug, wait until the kernel has noticed, and return the camera's last message."""
        end(self.guest, f"/tmp/iidc{self.port}.pid")
        self.guest.wait_until(f"! [ -e {in_kernel(self.port + 1)} ]", pause=0.05)
        return self.guest.sh(f"tail -n 1 /tmp/iidc{self.port}")


@dataclasses.dataclass
class Run:
    frames: list[camera.Frame]
    counters: Counters
    said: list[str]


class Grabber:
    """The grabber, run as its user, with a reader of its item."""

    def __init__(self, guest: Guest, arguments: str, name: str) -> None:
        self.guest, self.name = guest, name
        guest.sh(f"chpst -u {USER}:ddx {GRABBER} {arguments} -name {name} -instance {GRABBER}.{name} "
                 f"> /tmp/run.{name} 2> /tmp/said.{name} & echo $! > /tmp/run.{name}.pid; "
                 f"/tmp/frames {name} 600 64 > /tmp/frames.{name} 2>&1 & echo $! > /tmp/frames.{name}.pid")

    def _wait_until(self, condition: str) -> None:
        try:
            self.guest.wait_until(condition, pause=0.05)
        except Failed as failed:
            said = self.guest.sh(f"tail -n 5 /tmp/said.{self.name} /tmp/frames.{self.name}")
            raise Failed(f"{failed}\n{said}") from failed

    def wait(self, frames: int) -> None:
        """Wait until the reader has seen that number of frames."""
        self._wait_until(f"[ $(wc -l < /tmp/frames.{self.name}) -gt {frames} ]")

    def count(self) -> int:
        return int(self.guest.sh(f"wc -l < /tmp/frames.{self.name}")) - 1

    def wait_for_more(self, frames: int = 5) -> None:
        self.wait(self.count() + frames)

    def wait_said(self, text: str, times: int = 1) -> None:
        self._wait_until(f"[ $(grep -c '{text}' /tmp/said.{self.name}) -ge {times} ]")

    def stop(self) -> Run:
        for kind in ("run", "frames"):
            end(self.guest, f"/tmp/{kind}.{self.name}.pid")
        lines = self.guest.sh(f"cat /tmp/frames.{self.name}").splitlines()
        found = counters.of(f"{GRABBER}.{self.name}", self.guest.sh(f"cat /tmp/run.{self.name}"))
        if not found:
            raise Failed(self.guest.sh(f"cat /tmp/said.{self.name}"))
        said = self.guest.sh(f"cat /tmp/said.{self.name}").splitlines()
        return Run([camera.Frame(*(int(word, 0) for word in line.split())) for line in lines if line != "ready"],
                   found[0], [line.removeprefix(f"{GRABBER}: ") for line in said])


def wrong(run: Run, pictures: list[int], counted: bool = True) -> list[str]:
    """Violations of: in = out + lost, and each frame shows the picture of its number (any picture if not counted)."""
    counts, found = run.counters, []
    first = run.frames[0] if run.frames else None
    before = first.number - first.source_lost if first else 0  # frames before the reader opened the item
    if counts.waiting or counts.frames_in != counts.out + counts.lost_total or counts.out != before + len(run.frames):
        found.append(f"does not add up: {counts}, {len(run.frames)} frames seen")
    for frame in run.frames:
        if frame.checksum not in pictures or (counted and frame.checksum != pictures[frame.sequence % FRAMES]):
            found.append(f"{frame} shows a wrong picture")
    return found
