# SPDX-License-Identifier: GPL-2.0-or-later
"""Programs that send a clip over a lossy link, ours and others. Each writes the pictures that it shows into a file.

A peer is started in steps, because a receiver may join later: receive(), send(), then play() starts the clip. The rates
of the others are chosen so that their wire rate is that of ours when 30 % of the packets are lost."""
import dataclasses
import pathlib
import subprocess
import threading
import time
from collections.abc import Callable, Sequence

import numpy

from bench.clips import HEIGHT, PICTURE, RATE, SIZE, WIDTH, Pictures, pictures
from bench.programs import Programs, Watcher
from parts.common import MORTAL, TOP, Closing, wait_until
from parts.link.link import Link, Node
from parts.media.clip import frame_number
from parts.processes import kill
PORT = 8000
SECOND = 1_000_000_000
OURS = "ddxvideo"


@dataclasses.dataclass
class Shown:
    """The pictures that one operator saw: the number in each picture, its time (ns), and the picture."""
    numbers: list[int | None]  # wrong if the picture is damaged
    times: list[int]
    pictures: Pictures


class Peer(Closing):
    name = ""
    reports = True     # uses the return path
    deadline_ms = 100  # after the robot's write; a later frame is unusable
    program = ""       # a program that may not be installed

    def __init__(self, link: Link, clip: pathlib.Path, folder: pathlib.Path) -> None:
        self.link, self.clip, self.folder = link, clip, folder

    def receive(self) -> None:
        """Start all operators' programs."""

    def send(self) -> None:
        """Start the robot's program."""

    def play(self) -> None:
        """Start the clip; returns when the first frame is written."""

    def written(self) -> dict[int, int]:
        """Wait for the end of the clip: the time when the robot wrote each frame (ns), by number."""
        return {}

    def shown(self) -> list[Shown]:
        """The pictures of each operator."""
        return []

    def pictures_of(self, operator: int) -> pathlib.Path:
        return self.folder / f"shown-{operator}.yuv"

    def read_pictures(self, operator: int) -> Pictures:
        path = self.pictures_of(operator)
        data = numpy.fromfile(path, numpy.uint8) if path.exists() else numpy.zeros(0, numpy.uint8)
        return data[:len(data) // PICTURE * PICTURE].reshape(-1, PICTURE)


class Ours(Peer):
    """ddxvideosend and ddxdecode, each with its own store. `sender` and `receiver`: more options of them."""
    name = OURS

    def __init__(self, link: Link, clip: pathlib.Path, folder: pathlib.Path, sender: Sequence[str] = (),
                 receiver: Sequence[str] = ()) -> None:
        super().__init__(link, clip, folder)
        self.sender, self.receiver = sender, receiver
        self.robot = self._programs("robot", link.robot)
        self.operators = [self._programs(f"operator-{number}", node) for number, node in enumerate(link.operator)]
        self.video = self.robot.watch("video")
        self.seen: list[Watcher] = []

    def _programs(self, name: str, node: Node) -> Programs:
        (self.folder / name).mkdir()
        return Programs(self.folder / name, node.inside)

    def receive(self) -> None:
        for number, programs in enumerate(self.operators):
            self.seen.append(programs.watch("seen", self.pictures_of(number)))
            programs.start("ddxdecode", "-headless", "-name", "seen", *self.receiver)
            wait_until(lambda: programs.answers("ddxdecode"), "ddxdecode does not start")

    def send(self) -> None:
        self.robot.start("ddxvideosend", *self.sender)
        wait_until(lambda: self.robot.answers("ddxvideosend"), "ddxvideosend does not start")

    def play(self) -> None:
        self.loader = self.robot.start("ddxvideoload", str(self.clip), "-readers", "2")
        wait_until(lambda: self.robot.count("ddxvideoload", "out") > 0, "the clip is not played")

    def written(self) -> dict[int, int]:
        self.loader.wait(120)
        time.sleep(0.3)  # the last frames are on their way
        return {number: written for number, written in self.video.stop() if number is not None}

    def shown(self) -> list[Shown]:
        found = [watcher.stop() for watcher in self.seen]
        return [Shown([number for number, _ in one], [written for _, written in one], self.read_pictures(operator))
                for operator, one in enumerate(found)]

    def end(self) -> None:
        for programs in (self.robot, *self.operators):
            programs.end()


class Piped(Peer):
    """A pair of commands, for one operator: the sender gets each picture on standard input when it is due, the receiver
    writes pictures to standard output."""
    video_kbit = 0  # of the encoder
    deadline_ms = 250  # these tools delay a frame or two by design; only losses should count

    def __init__(self, link: Link, clip: pathlib.Path, folder: pathlib.Path) -> None:
        super().__init__(link, clip, folder)
        self.running: list[subprocess.Popen[bytes]] = []
        self.threads: list[threading.Thread] = []

    def sender_words(self, to: str) -> list[str]:
        raise NotImplementedError

    def receiver_words(self, robot: str) -> list[str]:
        raise NotImplementedError

    def start(self, node: Node, words: Sequence[str], name: str, stdin: int, stdout: int) -> subprocess.Popen[bytes]:
        with open(self.folder / f"errors-{name}", "w") as errors:
            process = subprocess.Popen([*MORTAL, *node.inside, *words], stdin=stdin, stdout=stdout, stderr=errors,
                                       cwd=TOP)
        self.running.append(process)
        return process

    def _thread(self, work: Callable[[], None]) -> threading.Thread:
        thread = threading.Thread(target=work)
        thread.start()
        self.threads.append(thread)
        return thread

    def receive(self) -> None:
        self.times: list[int] = []
        words = self.receiver_words(self.link.robot.address)
        self.receiver = self.start(self.link.operator[0], words, "receiver", subprocess.DEVNULL,
                                    subprocess.PIPE)
        self._thread(self._read)

    def _read(self) -> None:
        assert self.receiver.stdout
        with self.pictures_of(0).open("wb") as file:
            while len(picture := self.receiver.stdout.read(PICTURE)) == PICTURE:
                self.times.append(time.monotonic_ns())
                file.write(picture)

    def send(self) -> None:
        time.sleep(1)  # until the receiver listens: these programs do not report it
        self.sender = self.start(self.link.robot, self.sender_words(self.link.operator[0].address), "sender",
                                  subprocess.PIPE, subprocess.DEVNULL)

    def play(self) -> None:
        self.wrote: dict[int, int] = {}
        self.feeder = self._thread(self._feed)
        wait_until(lambda: bool(self.wrote) or not self.feeder.is_alive(), "the clip is not played")

    def _feed(self) -> None:
        assert self.sender.stdin
        begin = time.monotonic_ns()
        for number, picture in enumerate(pictures(self.clip)):
            time.sleep(max(0, begin + number * SECOND // RATE - time.monotonic_ns()) / SECOND)
            self.wrote[number] = time.monotonic_ns()
            try:
                self.sender.stdin.write(picture.tobytes())
                self.sender.stdin.flush()
            except BrokenPipeError:
                return

    def written(self) -> dict[int, int]:
        self.feeder.join()
        time.sleep(1)  # the last frames are on their way
        return self.wrote

    def shown(self) -> list[Shown]:
        self.end()
        shown = self.read_pictures(0)
        return [Shown([frame_number(picture.tobytes(), WIDTH, HEIGHT) for picture in shown], self.times, shown)]

    def end(self) -> None:
        for process in self.running:
            kill(process)
        for thread in self.threads:
            thread.join()


class FFmpeg(Piped):
    """MPEG-TS of H.264, as usual with these protocols, refreshed within a second. FFmpeg still delays a frame or two
    with all these options."""
    def url(self, host: str, receives: bool) -> str:
        raise NotImplementedError

    def sender_words(self, to: str) -> list[str]:
        rate = f"{self.video_kbit}k"
        return ["ffmpeg", "-v", "error", "-nostdin", "-fflags", "nobuffer", "-probesize", "32", "-f", "rawvideo",
                "-pix_fmt", "yuv420p", "-s", SIZE, "-r", str(RATE), "-i", "pipe:0", "-c:v", "libx264", "-preset",
                "superfast", "-tune", "zerolatency", "-b:v", rate, "-maxrate", rate, "-bufsize",
                f"{self.video_kbit * 2.5 / RATE:.0f}k", "-g", str(RATE), "-x264-params",
                "intra-refresh=1:no-psy=1:repeat-headers=1", "-flush_packets", "1", "-f", "mpegts",
                "-omit_video_pes_length", "0", "-pat_period", "1", "-sdt_period", "10", self.url(to, False)]

    def receiver_words(self, robot: str) -> list[str]:
        return ["ffmpeg", "-v", "error", "-nostdin", "-fflags", "noparse+nofillin", "-flags", "low_delay", "-probesize",
                "5000", "-analyzeduration", "0", "-threads", "1", "-f", "mpegts", "-i", self.url("0.0.0.0", True),
                "-fps_mode", "passthrough", "-f", "rawvideo", "-pix_fmt", "yuv420p", "-flush_packets", "1", "pipe:1"]


class Srt(FFmpeg):
    name, latency_ms, video_kbit = "SRT 80 ms", 80, 140

    def url(self, host: str, receives: bool) -> str:
        return (f"srt://{host}:{PORT}?mode={'listener' if receives else 'caller'}&latency={self.latency_ms * 1000}"
                "&pkt_size=1316&tlpktdrop=1")


class Srt120(Srt):
    """Its default."""
    name, latency_ms = "SRT 120 ms", 120


class Rist(FFmpeg):
    name, latency_ms, video_kbit = "RIST 80 ms", 80, 140

    def url(self, host: str, receives: bool) -> str:
        return f"rist://{'@' if receives else ''}{host}:{PORT}?rist_profile=simple&buffer={self.latency_ms}"
