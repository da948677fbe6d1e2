# SPDX-License-Identifier: GPL-2.0-or-later
"""Chromium plays recordings: opens, seeks, and shows which picture it displays."""
import base64
import json
import pathlib

from parts.media.browser import Browser
from parts.media.clip import frame_number

PAGE = pathlib.Path(__file__).with_name("player.html")


class Player(Browser):
    def __init__(self, folder: pathlib.Path) -> None:
        super().__init__([], folder, "--allow-file-access-from-files", "--autoplay-policy=no-user-gesture-required")
        self.open(PAGE)

    def load(self, path: pathlib.Path) -> float:
        """Opens a file; its length in s, -1 if Chromium does not know it."""
        return float(self.value(f"open_file({json.dumps(path.as_uri())})"))

    def seek(self, seconds: float) -> float:
        """Shows the frame at this time; the ms until it is displayed."""
        return float(self.value(f"seek({seconds})"))

    def play(self) -> float:
        """Plays to the end; the time there, s."""
        return float(self.value("play_all()"))

    def number(self) -> int | None:
        """The number in the picture on display, which has the size of CIF."""
        return frame_number(base64.b64decode(self.value("pixels()")), 352, 288)
