# SPDX-License-Identifier: GPL-2.0-or-later
"""`ddxctl stream` prints the description of the service's stream for players, and no other file."""
from __future__ import annotations

import pathlib
import subprocess
from collections.abc import Iterator

import pytest

from parts.common import wait_until
from parts.guest.native_machine import NativeMachine
from parts.media import clip, counters

pytestmark = pytest.mark.retry

SEND, LAPTOP = "ddxvideosend", "ddxvideosend.laptop"


@pytest.fixture(scope="module")
def machine(root: pathlib.Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[NativeMachine]:
    """A machine that plays a clip in a loop and can send to itself."""
    keep = tmp_path_factory.mktemp("robot")
    (keep / "test").mkdir()
    clip.write(keep / "test/clip.y4m", 1)
    for name, lines in (("ddxvideoload", "loop="), (SEND, "interface=lo"), ("ddxvideosave", "enabled=no")):
        (keep / f"test/{name}.conf").write_text(f"{lines}\n")
    with NativeMachine(root, keep) as robot:
        robot.wait_until("ddxctl status ddxhealth | grep -q state=running")  # the last init script has run
        yield robot


@pytest.fixture
def robot(machine: NativeMachine) -> NativeMachine:
    """The machine reset to its state after boot, without a stream. One boot serves all tests."""
    machine.run(f"ddxctl remove {LAPTOP}")
    machine.sh(f"ddxctl stop {SEND}; rm -f /run/stream/*; chown ddxsend /run/stream; ddxctl start ddxvideoload")
    machine.wait_until("ddxctl status ddxvideoload | grep -q state=running")
    return machine


def described(robot: NativeMachine, words: str = "") -> str:
    """The description that a laptop saves."""
    robot.wait_until(f"ddxctl stream {words} > /dev/null 2>&1")
    return robot.sh(f"ddxctl stream {words} 2> /dev/null")


def asked_at_once(robot: NativeMachine, words: str = "", before: str = "true") -> tuple[int, str]:
    """Run `ddxctl stream`, directly after the command `before`, without its waits of up to 5 s. A `usleep` in $PATH
    would not help: the image's shell has a builtin."""
    return robot.run(f"{before} > /dev/null; set -- {words}; usleep() {{ :; }}; . /usr/libexec/ddx/ctl-stream")


def sent(robot: NativeMachine) -> int:
    """Frames sent so far, including earlier starts."""
    return sum(one.out for one in counters.of(SEND, robot.run("ddxctl stats --json")[1]))


def played(robot: NativeMachine, sdp: pathlib.Path) -> bytes:
    """Twenty pictures of the stream, played in the robot's network."""
    inside = ["nsenter", "--net", "--target", str(robot.init)]
    source = ["-protocol_whitelist", "file,udp,rtp", "-i", str(sdp), "-frames:v", "20"]
    return subprocess.run([*inside, "ffmpeg", "-v", "error", "-nostdin", *source, "-pix_fmt", "gray", "-f", "rawvideo",
                           "-"], check=True, timeout=60, stdout=subprocess.PIPE).stdout


def test_the_description_plays_the_stream(robot: NativeMachine, tmp_path: pathlib.Path) -> None:
    off = f"ddxctl: stream: {SEND} is off; `ddxctl enable {SEND}` switches it on"
    assert robot.run("ddxctl stream") == (1, off)
    robot.sh(f"ddxctl enable {SEND}; ddxctl add {LAPTOP} group=none to=127.0.0.1 port=9000")
    text = described(robot)
    assert "c=IN IP4 239.255.20.5/1" in text and "m=video 8000 RTP/AVP 96" in text
    assert f"ddxctl add {SEND}.NAME group=none to=ADDRESS" in robot.sh("ddxctl stream 2>&1 > /dev/null")
    sdp = tmp_path / "laptop.sdp"
    sdp.write_text(described(robot, LAPTOP) + "\n")
    assert "c=IN IP4 127.0.0.1\n" in sdp.read_text() and robot.sh(f"ddxctl stream {LAPTOP} 2>&1 > /dev/null") == ""
    assert len(played(robot, sdp)) == 20 * clip.WIDTH * clip.HEIGHT
    robot.sh(f"ddxctl stop {SEND}")
    assert robot.run("ddxctl stream") == (1, off)


def test_no_description_of_an_earlier_stream(robot: NativeMachine) -> None:
    robot.sh(f"ddxctl enable {SEND}")
    described(robot)
    robot.sh("ddxctl stop ddxvideoload")
    status, said = asked_at_once(robot, before=f"ddxctl restart {SEND}")
    assert status == 1 and "has sent no picture yet" in said
    robot.sh("ddxctl start ddxvideoload")
    assert described(robot).startswith("v=0")


def test_root_s_files_are_not_printed(robot: NativeMachine) -> None:
    """Neither through a link of the sender's user nor by a name with slashes."""
    robot.sh(f"ddxctl enable {SEND}")
    described(robot)
    robot.sh("echo secret > /data/secret.sdp; chmod 600 /data/secret.sdp")
    robot.sh(f"chpst -u ddxsend:ddx ln -sf /data/secret.sdp /run/stream/{SEND}.sdp")
    for words, wanted in (("", 1), ("../../data/secret", 2), ("nonsense", 2)):
        status, said = asked_at_once(robot, words)
        assert status == wanted and "secret\n" not in said + "\n"
    assert f"there are: {SEND}" in robot.run("ddxctl stream nonsense")[1]


def test_the_stream_runs_if_its_description_cannot_be_written(robot: NativeMachine) -> None:
    robot.sh(f"chown root /run/stream; ddxctl enable {SEND}")
    robot.wait_until(f"ddxctl logs {SEND} | grep -q 'no description for players: Permission denied'")
    before = sent(robot)
    wait_until(lambda: sent(robot) > before, f"{SEND} sends no more frames")
