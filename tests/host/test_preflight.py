# SPDX-License-Identifier: GPL-2.0-or-later
"""tools/preflight: what `make run` checks before anything that takes time."""
from __future__ import annotations

import os
import pathlib
import shutil
import subprocess
from collections.abc import Iterator

import pytest

from parts.common import TOP

# A user without rights, and the group of that user.
OTHER = ("setpriv", "--reuid", "65534", "--regid", "65534", "--clear-groups")

pytestmark = [pytest.mark.retry, pytest.mark.skipif(os.geteuid() != 0, reason="makes namespaces and file systems")]


@pytest.fixture(name="tree")
def _tree(tmp_path: pathlib.Path) -> Iterator[pathlib.Path]:
    """A clone's tools, in a folder that each user may read."""
    for folder in tmp_path, *tmp_path.parents[:3]:
        if folder != pathlib.Path("/tmp"):
            folder.chmod(0o755)
    tree = tmp_path / "tree"
    shutil.copytree(TOP / "tools", tree / "tools", ignore=shutil.ignore_patterns("parts"))
    yield tree


def preflight(tree: pathlib.Path, home: pathlib.Path, *before: str, script: str = ":") -> tuple[int, list[str]]:
    """Its status and its lines, in a mount namespace of its own where the script has run."""
    run = f'{script}; exec "$@"'
    done = subprocess.run(["unshare", "--mount", "sh", "-c", run, "sh", *before, tree / "tools/preflight",
                           "output/run/dev/disk.img", "run"], capture_output=True, text=True, check=False,
                          env={"PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "HOME": str(home)})
    assert done.stderr == ""
    return done.returncode, done.stdout.splitlines()


def built(home: pathlib.Path) -> pathlib.Path:
    """A home where third-party parts were built, so that no network is needed."""
    (home / ".cache/ddxvideo/built").mkdir(parents=True)
    (home / ".cache/ddxvideo/built/FFmpeg-0.stamp").touch()
    return home


def test_nothing_to_say(tree: pathlib.Path, tmp_path: pathlib.Path) -> None:
    assert preflight(tree, built(tmp_path / "home"), "unshare", "--net") == (0, [])


def test_no_network(tree: pathlib.Path, tmp_path: pathlib.Path) -> None:
    (tmp_path / "home").mkdir()
    status, lines = preflight(tree, tmp_path / "home", "unshare", "--net")
    assert status == 1 and len(lines) == 1
    assert lines[0].startswith("make: no network: ") and lines[0].endswith(" cannot be reached")


def test_no_room(tree: pathlib.Path, tmp_path: pathlib.Path) -> None:
    home = built(tmp_path / "home")
    small = f"mount -t tmpfs -o size=100m none {home} && mkdir -p {home}/.cache/ddxvideo/built && " \
            f"touch {home}/.cache/ddxvideo/built/FFmpeg-0.stamp"
    status, lines = preflight(tree, home, script=small)
    assert status == 1 and len(lines) == 1
    assert lines[0].startswith(f"make: {home}: ") and lines[0].endswith("MB are free, 6000 MB are needed")


def test_the_output_of_another_user_and_no_right_to_kvm(tree: pathlib.Path, tmp_path: pathlib.Path) -> None:
    (tree / "output").mkdir()
    shutil.chown(tree, 65534, 65534)
    home = built(tmp_path / "home")
    devices = "mount -t tmpfs none /dev && mknod -m 666 /dev/null c 1 3 && touch /dev/kvm && chmod 600 /dev/kvm"
    status, lines = preflight(tree, home, *OTHER, script=devices)
    assert status == 1 and [line.split(":")[1] for line in lines] == [
        f" {tree}/output belongs to another user, perhaps after a `sudo make`",
        " you may not use /dev/kvm, so QEMU will emulate the processor, slowly"]


def test_each_tool_names_the_folder_of_another_user(tree: pathlib.Path) -> None:
    """In one line, where a traceback was after `sudo make`."""
    shutil.copytree(TOP / "tools/parts", tree / "tools/parts")
    (tree / "output").mkdir()
    done = subprocess.run([*OTHER, "/usr/bin/python3", "-B", tree / "tools/results.py"], capture_output=True, text=True,
                          check=False, env={"PATH": "/usr/bin:/bin"})
    assert (done.returncode, done.stderr) == (1, "")
    assert done.stdout == f"results: {tree}/output belongs to another user, perhaps after a `sudo make`: " \
        f"sudo chown -R $(id -un) {tree}\n"
