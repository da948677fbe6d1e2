# SPDX-License-Identifier: GPL-2.0-or-later
"""docs/technician.md: the laptop's commands work in the shells of Linux and macOS. `make docs` uses a robot."""
from __future__ import annotations

import json
import os
import pathlib
import shlex
import subprocess

import pytest

import docs
from parts.guest.laptop import SHELLS
from parts.media import clip

from .programs import Desk, ffmpeg, record

pytestmark = pytest.mark.retry

# Replaces a program that needs a robot: records its arguments.
NOTES = '#!/bin/sh\nfor word in "${0##*/}" "$@"; do printf "%s\\n" "$word"; done >> "$HOME/words"\n'


@pytest.fixture
def home(tmp_path: pathlib.Path) -> pathlib.Path:
    """A laptop's home folder with a key."""
    (tmp_path / ".ssh").mkdir()
    (tmp_path / ".ssh/id_ed25519.pub").write_text("ssh-ed25519 AAAA me\n")
    (tmp_path / "bin").mkdir()
    for name in ("ssh", "scp", "ssh-keygen", "ffmpeg"):
        (tmp_path / "bin" / name).write_text(NOTES)
        (tmp_path / "bin" / name).chmod(0o755)
    return tmp_path


def words(home: pathlib.Path, shell: str, command: str) -> tuple[int, str, list[str]]:
    """A command's exit status and messages, and the arguments of the programs that the shell started."""
    (home / "words").write_text("")
    done = subprocess.run([shell, "-c", command], cwd=home, timeout=60, capture_output=True, text=True, check=False,
                          env={"HOME": str(home), "PATH": f"{home}/bin:{os.environ['PATH']}"})
    return done.returncode, done.stderr, (home / "words").read_text().splitlines()


def test_each_shell_runs_each_line(home: pathlib.Path) -> None:
    lines = [command for machine, command in docs.commands() if machine == docs.LAPTOP]
    assert any("*" in line for line in lines)
    for line in lines:
        typed = shlex.split(line.partition(" > ")[0])
        started = typed if (home / "bin" / typed[0]).exists() else []
        for shell in SHELLS:
            assert words(home, shell, line) == (0, "", started), (shell, line)


def test_an_unquoted_pattern_fails_on_macos(home: pathlib.Path) -> None:
    """Proves that the check can fail: without quotes, macOS's shell starts no program."""
    status, said, started = words(home, "zsh-static", "scp root@robot1:/rec/*.y4m .")
    assert (status, started) == (1, []) and "no matches found" in said


@pytest.mark.parametrize("format", ["yuv420p", "yuv422p"])
def test_a_recording_becomes_an_mp4(desk: Desk, format: str) -> None:
    """The page's command keeps all pictures in order, in a format that every player supports."""
    line = next(command for _, command in docs.commands() if command.startswith("ffmpeg"))
    recording, movie = docs.EXAMPLE.findall(line)[0], line.split()[-1]
    source = desk.folder / "clip.y4m"
    source.write_bytes(ffmpeg("-i", clip.write(desk.folder / "numbers.y4m", 1), "-pix_fmt", format, "-f",
                              "yuv4mpegpipe", "-"))
    record(desk, source, desk.folder / "".join(recording), "-rate", "4")
    subprocess.run(["sh", "-c", line], cwd=desk.folder, check=True, timeout=60, capture_output=True,
                   stdin=subprocess.DEVNULL)
    shown = json.loads(subprocess.run(["ffprobe", "-v", "error", "-show_streams", "-of", "json", movie], check=True,
                                      cwd=desk.folder, timeout=60, capture_output=True).stdout)["streams"]
    assert [(one["codec_name"], one["pix_fmt"]) for one in shown] == [("h264", "yuv420p")]
    pixels = clip.WIDTH * clip.HEIGHT
    luma = ffmpeg("-i", desk.folder / movie, "-fps_mode", "passthrough", "-pix_fmt", "gray", "-f", "rawvideo", "-")
    assert [clip.frame_number(luma[at:at + pixels], clip.WIDTH, clip.HEIGHT)
            for at in range(0, len(luma), pixels)] == list(range(clip.RATE))
