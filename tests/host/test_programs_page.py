# SPDX-License-Identifier: GPL-2.0-or-later
"""docs/programs.md: its example, added to a copy of the tree as the page says, is a service of the image."""
from __future__ import annotations

import os
import pathlib
import re
import shutil
import subprocess
import sys

import pytest

from parts.common import TOP
from parts.guest.native_machine import NativeMachine
from parts.image import busybox, ffmpeg
from parts.media import clip

pytestmark = pytest.mark.retry

NAME, USER, NUMBER = "ddxvideodark", "ddxdark", "910"
PAGE = TOP / "docs/programs.md"
TABLE = "package/ddxvideo/programs.txt"
# Run in the copy with its tools: compiles the needed packages, with the options of the desk build, so that ccache has
# all but the page's program; and makes the root of them.
BUILD = """
import pathlib, sys
from parts.image import native, rootfs
packages = native.build("desk", chosen=["ddx", "ddxservice", "ddxvideo"], tests=False)
root, shell, kernel, codecs = map(pathlib.Path, sys.argv[1:])
rootfs.assemble(root, shell, kernel, [packages, codecs])
"""


def files() -> dict[str, str]:
    """The page's files, by their path in the tree."""
    return dict(re.findall(r"^`(package/\S+)`\n\n```\w*\n(.*?)^```$", PAGE.read_text(), re.M | re.S))


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    tree = tmp_path_factory.mktemp("tree")
    for folder in ("package", "board", "overlay", "tools"):
        shutil.copytree(TOP / folder, tree / folder, symlinks=True)
    for name, text in files().items():
        path = tree / name
        path.parent.mkdir(exist_ok=True)
        path.write_text((path.read_text() if name == TABLE else "") + text)
    (tree / "kernel/lib").mkdir(parents=True)
    subprocess.run([sys.executable, "-B", "-c", BUILD, tree / "root", busybox.busybox(), tree / "kernel",
                    ffmpeg.ffmpeg()], cwd=tree / "tools", check=True, timeout=600)
    return tree / "root"


def test_the_page_has_all_files_of_a_program() -> None:
    folder = "package/ddxvideo/dark/"
    assert set(files()) == {TABLE, *(folder + name for name in ("main.c", "meson.build", f"{NAME}.default"))}
    assert files()[TABLE].split()[:4] == ["dark", f"S62{NAME}", USER, NUMBER]


def test_program_user_script_and_settings_are_in_the_image(root: pathlib.Path) -> None:
    assert (root / "usr/bin" / NAME).read_bytes().startswith(b"\x7fELF")
    assert f"{USER}:x:{NUMBER}:900:reports when a camera sees nothing:" in (root / "etc/passwd").read_text()
    script = root / f"etc/init.d/S62{NAME}"
    assert os.access(script, os.X_OK)
    assert f"# Reports when a camera sees nothing; settings in /etc/default/{NAME} and" in script.read_text()
    assert f"user={USER}\n" in (root / "etc/default" / NAME).read_text()


def test_the_example_runs_as_a_service(root: pathlib.Path, tmp_path: pathlib.Path) -> None:
    if os.geteuid() != 0:
        pytest.skip("a machine in its own namespaces needs root")
    (tmp_path / "test").mkdir()
    clip.write(tmp_path / "test/clip.y4m", 1)
    (tmp_path / "test/ddxvideoload.conf").write_text("loop=\n")
    (tmp_path / f"test/{NAME}.conf").write_text("limit=255\n")  # each picture is darker
    with NativeMachine(root, tmp_path) as robot:
        table = [line.split() for line in robot.sh("ddxctl services").splitlines()]
        assert [NAME, "no", "stopped", "-", "0"] in table
        robot.sh(f"ddxctl enable {NAME}")
        robot.wait_until(f"ddxctl status {NAME} | grep -q state=running")
        robot.wait_until(f"ddxctl logs {NAME} | grep -q '{NAME}: video: the picture is dark'")
        robot.wait_until(f"ddxctl stats --json | grep '\"instance\":\"{NAME}\"' | grep -qv '\"out\":0,'")
        assert robot.sh(f"stat -c %u /proc/$(pidof {NAME})") == NUMBER
        robot.sh(f"ddxctl disable {NAME}")
        assert robot.run(f"pidof {NAME}")[0] == 1
