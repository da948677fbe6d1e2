# SPDX-License-Identifier: GPL-2.0-or-later
"""`make boot`: SSH and the screen are where it says, frames come, and it stops when the guest is switched off."""
import re
import shlex
import socket
import subprocess
import sys

import pytest

from parts.common import MORTAL, PATIENCE, TOP, wait_until

pytestmark = pytest.mark.retry


@pytest.mark.long
def test_a_guest_to_look_around_in() -> None:
    process = subprocess.Popen([*MORTAL, sys.executable, "-B", TOP / "tools/boot_image.py"], cwd=TOP,
                               stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True)
    assert process.stdout
    said = ""
    while "it runs until" not in said:
        line = process.stdout.readline()
        assert line, said
        said += line
    ssh = re.search(r"^boot: (ssh .*)$", said, re.M)
    screen = re.search(r"VNC viewer at 127\.0\.0\.1:(\d+)$", said, re.M)
    assert ssh and screen
    words = shlex.split(ssh[1])

    def typed(command: str) -> "subprocess.CompletedProcess[str]":
        return subprocess.run([*words, "-o", "ConnectTimeout=5", command], cwd=TOP, capture_output=True,
                              text=True, check=False, timeout=PATIENCE)

    wait_until(lambda: typed("true").returncode == 0, "no answer at the port for SSH", pause=1)
    wait_until(lambda: "video" in typed("ddxctl list").stdout, "no video item", pause=1)
    first = typed("ddxctl stats --json").stdout
    assert '"ddxvideosave"' in first and '"ddxvideoload"' in first
    with socket.create_connection(("127.0.0.1", int(screen[1])), PATIENCE) as viewer:
        assert viewer.recv(3) == b"RFB"
    typed("poweroff")
    assert process.wait(PATIENCE) == 0
