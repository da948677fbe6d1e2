# SPDX-License-Identifier: GPL-2.0-or-later
"""The paper's option style, and what is said about wrong usage: one line, exit 2."""
from __future__ import annotations

import json
import pathlib
import re
import subprocess

import pytest

from .programs import ROOT, Desk, library_folder, make_clip, wait_until

LOADER, SAVER, SENDER, DECODE, SNAP = "ddxvideoload", "ddxvideosave", "ddxvideosend", "decode", "ddxvideosnap"


def run(program: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    """Without any store: wrong usage is found before one is asked for."""
    return subprocess.run([ROOT / "bin" / program, *map(str, arguments)], capture_output=True, text=True, timeout=60,
                          env={"LD_LIBRARY_PATH": str(library_folder()), "DDX_DIR": "/nonexistent"})


@pytest.mark.parametrize("program", [
    LOADER, SAVER, SENDER, DECODE, SNAP, "ddxvideoV4L", "ddxvideo1394", "ddxhealth", "ddxlog", "store", "ddxctl",
    "ddxrecordings", "../sbin/ddxgrow"])
def test_version(program: str) -> None:
    result = run(program, "-version")
    assert result.returncode == 0 and not result.stderr
    assert re.fullmatch(pathlib.Path(program).name + r" \d+\.\d+\.\d+\n", result.stdout)


@pytest.mark.parametrize("program", [LOADER, SAVER, "ddxctl", "ddxlog"])
def test_help_where_the_loader_knows_no_library(program: str) -> None:
    """It lies beside the program, wherever that was installed."""
    result = subprocess.run([ROOT / "bin" / program, "-help"], capture_output=True, text=True, timeout=60,
                            env={"PATH": "/usr/bin"})
    assert result.returncode == 0 and result.stdout.startswith("usage: " + program)


@pytest.mark.parametrize("arguments,text", [
    (["watch", "x", "-count", "1.9"], "1.9: -count takes a whole number"),
    (["list", "-port", "2005abc"], "2005abc: -port takes a whole number"),
    (["list", "-port", "1e3"], "1e3: -port takes a whole number"),
    (["show", "n" * 64], "1 to 63 bytes"),
    (["set", "two words", "a=1"], "two words: no name"),
])
def test_bad_words_to_ddxctl(arguments: list[str], text: str) -> None:
    result = run("ddxctl", *arguments)
    assert result.returncode == 2 and text in result.stderr and result.stderr.count("\n") == 1


def test_store_port(tmp_path: pathlib.Path) -> None:
    result = subprocess.run([ROOT / "bin/store", "-port", "2005abc"], capture_output=True, text=True, timeout=20,
                            env={"DDX_DIR": str(tmp_path)})
    assert result.returncode == 2 and "2005abc: not a port" in result.stderr


def test_output_that_cannot_be_written(desk: Desk) -> None:
    with open("/dev/full", "w") as full:
        for arguments in (["list"], ["list", "--json"], ["-help"]):
            done = subprocess.run([ROOT / "bin/ddxctl", *arguments], env=desk.environment, stdout=full,
                                  stderr=subprocess.PIPE, text=True, timeout=60)
            assert done.returncode == 1 and done.stderr == "ddxctl: standard output: No space left on device\n"


def test_odd_names_as_json(desk: Desk) -> None:
    """Quotes and backslashes may be in a name."""
    name = 'a"b\\c'
    clip = make_clip(desk.folder / "clip.y4m", "64x48", "25", 3)
    assert desk.run(LOADER, clip, "-rate", "0", "-name", name).returncode == 0
    watch = desk.start("ddxctl", "watch", name, "-json", "-count", "1")
    wait_until(lambda: desk.readers(name) == 1)
    assert desk.run(LOADER, clip, "-rate", "0", "-name", name).returncode == 0
    assert watch.stdout and json.loads(watch.stdout.readline())["name"] == name
