# SPDX-License-Identifier: GPL-2.0-or-later
"""The Python module `ddx`, and `make desktop`, which installs it with all that programs are written with."""
from __future__ import annotations

import pathlib
import re
import subprocess

import pytest

from parts.common import MORTAL

from .programs import TOP, Desk, make_clip, pictures, wait_until

CLIENT = pathlib.Path(__file__).with_name("python_client.py")
PYTHON = ["/usr/bin/python3", "-B"]


@pytest.mark.parametrize("function", re.findall(r"^def (\w+)\(store", CLIENT.read_text(), re.M))
def test_module(desk: Desk, function: str) -> None:
    done = subprocess.run([*PYTHON, CLIENT, function], capture_output=True, text=True, timeout=60, check=False,
                          env={**desk.environment, "PYTHONPATH": str(TOP / "package/ddx/python")})
    assert done.returncode == 0, done.stderr


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    folder = tmp_path_factory.mktemp("desktop")
    subprocess.run(["make", "-s", "desktop", "PREFIX=/opt/ddx", f"DESTDIR={folder}"], cwd=TOP, check=True, timeout=600)
    return folder


def test_desktop_stays_below_its_prefix(installed: pathlib.Path) -> None:
    files = {str(path.relative_to(installed)) for path in installed.rglob("*") if path.is_file()}
    assert all(name.startswith("opt/ddx/") for name in files)
    names = {pathlib.Path(name).name for name in files}
    assert {"store", "ddxctl", "ddxvideosave", "ddx.h", "ddxvideo.h", "libddx.so", "ddx.pc", "ddx.py"} <= names
    assert not [name for name in files if "init.d" in name or "default" in name]


def test_examples_of_the_manual(desk: Desk, installed: pathlib.Path, tmp_path: pathlib.Path) -> None:
    """Built and run with what `make desktop` installs, beside a clip whose pictures are known."""
    prefix = installed / "opt/ddx"
    library = next(prefix.glob("lib/**/libddx.so")).parent
    environment = {**desk.environment, "LD_LIBRARY_PATH": str(library), "PKG_CONFIG_SYSROOT_DIR": str(installed),
                   "PKG_CONFIG_PATH": str(library / "pkgconfig"),
                   "PYTHONPATH": str(next(prefix.glob("lib/python*/**/ddx.py")).parent)}
    flags = subprocess.run(["pkg-config", "--cflags", "--libs", "ddx"], env=environment, capture_output=True, text=True,
                           check=True).stdout.split()
    program = tmp_path / "reader"
    subprocess.run(["gcc", "-Wall", "-Wextra", "-Werror", TOP / "examples/reader.c", "-o", program, *flags], check=True)
    clip = make_clip(tmp_path / "clip.y4m", frames=10)
    sums = [sum(picture[:352 * 288]) for picture in pictures(clip)]

    # The item exists from its first writer on, so that both readers find it.
    assert desk.run("ddxvideoload", clip).returncode == 0
    # Each ends when there was no frame for a second, and keeps one frame: the slow starter first, and a slow clip.
    readers = []
    for command in [*PYTHON, str(TOP / "examples/reader.py")], [str(program)]:
        readers.append(subprocess.Popen([*MORTAL, *command], env=environment, stdout=subprocess.PIPE, text=True))
        wait_until(lambda: f'"readers":{len(readers)},' in desk.run("ddxctl", "list", "--json").stdout)
    loader = desk.run("ddxvideoload", clip, "-readers", "2", "-rate", "0.2")
    assert loader.returncode == 0, loader.stderr
    for reader in readers:
        out, _ = reader.communicate(timeout=60)
        lines = [[int(word) for word in line.split()] for line in out.splitlines()]
        assert reader.returncode == 0
        assert [line[3] for line in lines] == sums
        assert [line[0] for line in lines] == list(range(11, 21)) and [line[2] for line in lines] == [0] * 10
        assert [line[1] for line in lines] == sorted({line[1] for line in lines})


@pytest.mark.parametrize("name, language", [("reader.c", "c"), ("reader.py", "python")])
def test_the_manual_shows_the_examples(name: str, language: str) -> None:
    _, text = (TOP / "examples" / name).read_text().split("\n", 1)  # without the licence line
    assert f"```{language}\n{text}```\n" in (TOP / "docs/store.md").read_text()
    assert len(text.splitlines()) <= 20
