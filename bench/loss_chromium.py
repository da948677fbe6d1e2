# SPDX-License-Identifier: GPL-2.0-or-later
"""Chromium's WebRTC over a lossy link: two headless instances with the page chromium.html, the clip as camera."""
import base64
import json
import pathlib
import time

from bench.clips import HEIGHT, WIDTH
from bench.loss_peers import Peer, Shown
from parts.common import wait_until
from parts.link.link import Link, Node
from parts.media.browser import PROGRAM, Browser
from parts.media.clip import frame_number

PAGE = pathlib.Path(__file__).with_name("chromium.html")
SOME = 20  # pictures at a time
ALL_KBIT = 235  # with IP and UDP headers 250


class Chromium(Peer):
    """VP8, retransmission and ULPFEC, as Chromium chooses them, without a server. `video_kbit` is the encoder's limit.
    mDNS names are off, since nothing resolves them here."""
    name, program, video_kbit = "Chromium WebRTC", PROGRAM, 150

    def __init__(self, link: Link, clip: pathlib.Path, folder: pathlib.Path) -> None:
        super().__init__(link, clip, folder)
        self.running: list[Browser] = []

    def _browser(self, node: Node, name: str) -> Browser:
        browser = Browser(node.inside, self.folder / name, "--disable-features=WebRtcHideLocalIpsWithMdns",
                          "--use-fake-ui-for-media-stream", "--use-fake-device-for-media-stream",
                          f"--use-file-for-fake-video-capture={self.clip}")
        self.running.append(browser)
        browser.open(PAGE)
        return browser

    def receive(self) -> None:
        self.operator = self._browser(self.link.operator[0], "operator")

    def send(self) -> None:
        self.robot = self._browser(self.link.robot, "robot")
        offer = self.robot.value("offer()")
        answer = self.operator.value(f"answer({json.dumps(offer)})")
        self.robot.value(f"connect({json.dumps(answer)}, {self.video_kbit}, {ALL_KBIT})")

    def play(self) -> None:
        self.robot.value("send()")
        wait_until(lambda: bool(self.robot.value("written.length > 0")), "the clip is not played")

    def written(self) -> dict[int, int]:
        wait_until(lambda: bool(self.robot.value("capture.readyState === 'ended'")), "the clip does not end")
        time.sleep(1)  # the last frames are on their way
        begin = self.robot.clock()
        return {number: begin + int(ms * 1e6) for number, ms in self.robot.value("written")}

    def shown(self) -> list[Shown]:
        begin = self.operator.clock()
        times = [begin + int(ms * 1e6) for ms in self.operator.value("times")]
        with self.pictures_of(0).open("wb") as file:
            for at in range(0, len(times), SOME):
                url = self.operator.value(f"pictures({at}, {min(at + SOME, len(times))})")
                file.write(base64.b64decode(url.split(",", 1)[1]))
        shown = self.read_pictures(0)
        return [Shown([frame_number(picture.tobytes(), WIDTH, HEIGHT) for picture in shown], times, shown)]

    def end(self) -> None:
        for browser in self.running:
            browser.end()
