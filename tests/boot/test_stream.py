# SPDX-License-Identifier: GPL-2.0-or-later
"""A stream in the image, from the store through the network to ddxdecode, while the recorder runs."""
import re

import pytest

from parts.guest import qemu

from .networked import FRAMES, Streamed

pytestmark = pytest.mark.strict


def test_the_sender_is_off_by_default(guest: qemu.Guest) -> None:
    code, text = guest.shell().run("/etc/init.d/S*ddxvideosend status")
    assert code == 3 and "enabled=no state=stopped" in text


def test_stream(streamed: Streamed) -> None:
    """Each frame shown has the number that ddxdecode prints."""
    assert streamed.result.good, streamed.result.disagreements  # the recording is not affected
    numbers = [int(match[1]) for line in streamed.shown if (match := re.match(r"frame (\d+) ", line))]
    assert numbers and numbers == sorted(set(numbers)), streamed.said
    assert streamed.packets["lost"] == streamed.packets["garbage"] == 0
    assert streamed.frames["in"] == streamed.frames["out"] + sum(streamed.frames["lost"].values())
    print(f"{len(numbers)} of {FRAMES} frames shown, {streamed.frames}")
