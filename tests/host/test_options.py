# SPDX-License-Identifier: GPL-2.0-or-later
"""The paper's option style; wrong usage gives one line and exit status 2."""
from __future__ import annotations

import json
import pathlib
import re
import subprocess

import pytest

from .programs import ROOT, Desk, library_folder, make_clip, wait_until

pytestmark = pytest.mark.retry

LOADER, SAVER, SENDER, DECODE = "ddxvideoload", "ddxvideosave", "ddxvideosend", "ddxdecode"
SNAP, VIEW, SVS = "ddxvideosnap", "ddxvideoview", "ddxvideoSVS"


def run(program: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    """Run without a store: wrong usage is found before a store is needed."""
    return subprocess.run([ROOT / "bin" / program, *map(str, arguments)], capture_output=True, text=True, timeout=60,
                          env={"LD_LIBRARY_PATH": str(library_folder()), "DDX_DIR": "/nonexistent"})


@pytest.mark.parametrize("program", [LOADER, SAVER, SENDER, DECODE, SNAP, VIEW, SVS])
@pytest.mark.parametrize("option", ["-help", "--help"])
def test_help(program: str, option: str) -> None:
    result = run(program, option)
    assert result.returncode == 0 and not result.stderr
    for word in ("usage: " + program, "-name", "-instance", "-store", "-help", "Exit status"):
        assert word in result.stdout
    assert all(len(line) <= 110 for line in result.stdout.splitlines())


@pytest.mark.parametrize("program,arguments,text", [
    (LOADER, [], "FILE is missing"),
    (LOADER, ["-frobnicate", "x.y4m"], "unknown option -frobnicate"),
    (LOADER, ["--frobnicate=3", "x.y4m"], "unknown option --frobnicate"),
    (LOADER, ["x.y4m", "y.y4m"], "unexpected argument y.y4m"),
    (LOADER, ["x.y4m", "-rate"], "-rate needs a value"),
    (LOADER, ["x.y4m", "-rate", "fast"], "-rate fast: a number"),
    (LOADER, ["x.y4m", "-rate", "-1"], "-rate -1: a number"),
    (LOADER, ["x.y4m", "-readers", "many"], "-readers many: a number"),
    (LOADER, ["x.y4m", "-store", "99999"], "-store 99999: a number"),
    (LOADER, ["x.y4m", "-name", ""], "-name is empty"),
    (SAVER, [], "-output is missing"),
    (SAVER, ["-output", "x.y4m", "more"], "unexpected argument more"),
    (SAVER, ["-output", "x.y4m", "-ring", "1"], "-ring 1: a number"),
    (SAVER, ["-output", "/tmp/x.y4m", "-instance", "n" * 60], "-instance"),
    (SAVER, ["-output", "/tmp/x.y4m", "-instance", "a/b"], "-instance a/b: a name without blanks and slashes"),
    (SAVER, ["-output", "/tmp/x.y4m", "-name", "n" * 64], "a name of at most 63 bytes"),
    (LOADER, ["x.y4m", "-name", "n" * 55], "a name of at most 52 bytes"),
    (LOADER, ["x.y4m", "-name", "two words"], "-name two words: a name without blanks"),
    (LOADER, ["x.y4m", "-store", " 7"], "-store  7: a number"),
    (SENDER, ["-codec", "h265"], "-codec h265"),
    (SENDER, ["-port", "8001"], "-port 8001: an even number"),
    (SENDER, ["-port", "70000"], "-port 70000: a number"),
    (SENDER, ["-group", "10.0.0.1"], "-group 10.0.0.1: a multicast address"),
    (SENDER, ["-group", "none"], "no receiver"),
    (SENDER, ["-to", "robot.local"], "-to robot.local: addresses are needed"),
    (SENDER, ["-to", "10.0.0.1:0"], "-to 10.0.0.1:0: addresses are needed"),
    (SENDER, ["-to", ",".join(["10.0.0.1"] * 16)], "-to 10.0.0.1"),
    (SENDER, ["-to", "10.0.0.1,fe80::2"], "-to fe80::2: addresses are needed"),
    (SENDER, ["-group", "fd00::1"], "-group fd00::1: a multicast address"),
    (SENDER, ["-ts", "8101"], "-ts 8101: an even number"),
    (SENDER, ["-ts", "8002"], "-ts 8002: this port is reserved"),
    (SENDER, ["-sap", "maybe"], "-sap maybe: yes or no"),
    (SENDER, ["-bitrate", "1"], "-bitrate 1: a number"),
    (DECODE, ["-group", "239.255.20.5:8000"], "-group 239.255.20.5:8000: a multicast address"),
    (DECODE, ["-group", "[ff15::5]:8000"], "-group [ff15::5]:8000: a multicast address"),
    (DECODE, ["-record", "x.mp4"], "-record: a file .avi or .mkv"),
    (SNAP, [], "FILE is missing"),
    (SNAP, ["x.bmp"], "x.bmp: a name that ends in"),
    (SNAP, ["ppm"], "ppm: a name that ends in"),
    (VIEW, ["x.y4m", "y.y4m"], "unexpected argument y.y4m"),
    (VIEW, ["-name", "a", "x.y4m"], "one of -name, -port and FILE is needed"),
    (VIEW, ["-port", "8001"], "-port 8001: an even number"),
    (VIEW, ["-port", "8000", "-group", "10.0.0.1"], "-group 10.0.0.1: a multicast address"),
    (VIEW, ["-memory", "12x"], "-memory 12x: a size of at least 1M"),
    (VIEW, ["-memory", "100K"], "-memory 100K: a size of at least 1M"),
    (VIEW, ["-history", "0"], "-history 0: a number"),
    (SVS, [], "-calib is missing"),
    (SVS, ["-top", "middle"], "-top middle: left or right is needed"),
    (SVS, ["-disparities", "40"], "-disparities 40: a multiple of 16 is needed"),
    (SVS, ["-disparities", "272"], "-disparities 272: a number"),
    (SVS, ["-window", "0"], "-window 0: a number"),
    (SVS, ["-left", "left"], "-left and -right go together"),
    (SVS, ["-left", "same", "-right", "same"], "-left and -right are the same item"),
    (SVS, ["-from", "video", "-right", "right"], "-from is one item with both eyes"),
    (SVS, ["-name", "n" * 54], "a name of at most 53 bytes"),
    ("ddxcatalog", ["-machine", "a.b"], "-machine a.b: a name of 1 to 32 letters"),
    ("ddxcatalog", ["-c", "/nonexistent/exports.conf"], "/nonexistent/exports.conf: No such file"),
])
def test_bad_usage(program: str, arguments: list[str], text: str) -> None:
    result = run(program, *arguments)
    assert result.returncode == 2
    assert result.stderr.startswith(program + ": ") and text in result.stderr
    assert result.stderr.count("\n") == 1 and not result.stdout


@pytest.mark.parametrize("program,arguments", [
    (LOADER, ["x.y4m"]), (SAVER, ["-output", "/nonexistent/x.y4m"]), (SENDER, ["-codec", "mpeg4"]), (DECODE, []),
    (SNAP, ["x.png"]), (VIEW, ["x.y4m"])])
def test_check_only_validates_the_options(program: str, arguments: list[str]) -> None:
    """There is no store: a program that started would wait for one."""
    good, bad = run(program, *arguments, "-check"), run(program, "-check", *arguments, "-name", "")
    assert good.returncode == 0 and not good.stdout and not good.stderr
    assert bad.returncode == 2 and "-name is empty" in bad.stderr


@pytest.mark.parametrize("place", ["/nonexistent/out.y4m", "/nonexistent/", "/etc/passwd/out.y4m"])
def test_an_output_folder_that_cannot_be_written(place: str) -> None:
    result = run(SAVER, "-output", place)
    assert result.returncode == 1 and result.stderr.count("\n") == 1 and place in result.stderr


GOOD = "YUV4MPEG2 W64 H48 F25:1 C420jpeg\n"


@pytest.mark.parametrize("content,text", [
    (b"", "is empty"),
    (b"RIFF....AVI LIST", "no Y4M"),
    (bytes(range(256)) * 40, "no Y4M"),
    (b"YUV4MPEG2 " + b"X" * 5000, "too long"),
    (b"YUV4MPEG2 W64 H48", "cut short"),
    (b"YUV4MPEG2 W64 H48\0\n", "zero byte"),
    (b"\0\0\0 ftypisom\0\0\2\0isomiso2avc1mp41\n", "make a Y4M file: ffmpeg -i FILE -pix_fmt yuv420p OUT.y4m"),  # MP4
    (b"YUV4MPEG2 F25:1\n", "missing or zero"),
    (b"YUV4MPEG2 W0 H0\n", "missing or zero"),
    (b"YUV4MPEG2 W63 H48\n", "odd size 63x48"),
    (b"YUV4MPEG2 W64 H47\n", "odd size 64x47"),
    (b"YUV4MPEG2 W16384 H48\n", "too large"),
    (b"YUV4MPEG2 W999999999999999999999999 H48\n", "no size"),
    (b"YUV4MPEG2 W64 H48 Cbayer\n", "colourspace 'Cbayer'"),
    (b"YUV4MPEG2 W64 H48 F25:0\n", "frame rate"),
])
def test_bad_clip(tmp_path: pathlib.Path, content: bytes, text: str) -> None:
    clip = tmp_path / "clip.y4m"
    clip.write_bytes(content)
    check_refused(clip, text)


def test_a_missing_clip(tmp_path: pathlib.Path) -> None:
    check_refused(tmp_path / "none.y4m", "cannot be opened")
    check_refused(tmp_path, "cannot be read")


def check_refused(clip: pathlib.Path, text: str) -> None:
    result = run(LOADER, clip)
    assert result.returncode == 2
    assert result.stderr.startswith(f"{LOADER}: {clip}: ") and text in result.stderr
    assert result.stderr.count("\n") == 1 and result.stderr.isprintable() is False and "\x1b" not in result.stderr


@pytest.mark.parametrize("program", [
    LOADER, SAVER, SENDER, DECODE, SNAP, VIEW, "ddxvideoV4L", "ddxvideo1394", "ddxvideoplay", "ddxhealth", "ddxlog",
    "ddxcatalog", "ddxstore", "ddxctl", "ddxrecordings", "../sbin/ddxgrow"])
def test_version(program: str) -> None:
    result = run(program, "-version")
    assert result.returncode == 0 and not result.stderr
    assert re.fullmatch(pathlib.Path(program).name + r" \d+\.\d+\.\d+\n", result.stdout)


@pytest.mark.parametrize("program", [LOADER, SAVER, "ddxctl", "ddxlog"])
def test_help_without_installed_libraries(program: str) -> None:
    """The library is found relative to the program."""
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


@pytest.mark.parametrize("arguments,needed", [
    (["-field", "0"], "all, or a number from 1 to 16,"),
    (["-field", "17"], "all, or a number from 1 to 16,"),
    (["-field", "1a"], "all, or a number from 1 to 16,"),
    (["-fit", "large"], "shape, fill or pixels"),
    (["-mode", "640"], "a size such as 1024x768"),
    (["-mode", "640x480x32"], "a size such as 1024x768"),
    (["-mode", "0x480"], "a size such as 1024x768"),
    (["-text", "yes"], "on or off"),
])
def test_bad_words_to_ddxvideoplay(arguments: list[str], needed: str) -> None:
    result = run("ddxvideoplay", *arguments)
    assert result.returncode == 2
    assert result.stderr == f"ddxvideoplay: {' '.join(arguments)}: {needed} is needed; see ddxvideoplay -help\n"


def test_a_wrong_port_of_the_store(tmp_path: pathlib.Path) -> None:
    result = subprocess.run([ROOT / "bin/ddxstore", "-port", "2005abc"], capture_output=True, text=True, timeout=20,
                            env={"DDX_DIR": str(tmp_path)})
    assert result.returncode == 2 and "2005abc: not a port" in result.stderr


def test_output_that_cannot_be_written(desk: Desk) -> None:
    with open("/dev/full", "w") as full:
        for arguments in (["list"], ["list", "--json"], ["-help"]):
            done = subprocess.run([ROOT / "bin/ddxctl", *arguments], env=desk.environment, stdout=full,
                                  stderr=subprocess.PIPE, text=True, timeout=60)
            assert done.returncode == 1 and done.stderr == "ddxctl: standard output: No space left on device\n"


def test_special_characters_in_names_as_json(desk: Desk) -> None:
    """Names may contain quotes and backslashes."""
    name = 'a"b\\c'
    clip = make_clip(desk.folder / "clip.y4m", "64x48", "25", 3)
    assert desk.run(LOADER, clip, "-rate", "0", "-name", name).returncode == 0
    watch = desk.start("ddxctl", "watch", name, "-json", "-count", "1")
    wait_until(lambda: desk.readers(name) == 1)
    assert desk.run(LOADER, clip, "-rate", "0", "-name", name).returncode == 0
    assert watch.stdout and json.loads(watch.stdout.readline())["name"] == name
