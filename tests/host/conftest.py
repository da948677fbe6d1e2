# SPDX-License-Identifier: GPL-2.0-or-later
from __future__ import annotations

import os
import pathlib
import subprocess
from collections.abc import Iterator

import pytest

import build
from parts.image import native
from parts.media import clip as numbered_clip

from .programs import Compiler, Desk
from .stream import Stream


@pytest.fixture(scope="session", autouse=True)
def programs() -> None:
    """Build the tested programs from the current tree."""
    if "DDX_ROOT" not in os.environ:
        native.build()


@pytest.fixture
def desk(tmp_path: pathlib.Path) -> Iterator[Desk]:
    desk = Desk(tmp_path)
    yield desk
    desk.end()


@pytest.fixture
def small_disk(tmp_path: pathlib.Path) -> Iterator[pathlib.Path]:
    """A file system of 64 KiB."""
    folder = tmp_path / "small"
    folder.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=64k", "none", folder], capture_output=True, text=True)
    if mounted.returncode:
        pytest.skip(f"cannot mount a small file system: {mounted.stderr.strip()}")
    yield folder
    subprocess.run(["umount", "-l", folder], check=True)


@pytest.fixture
def stream(tmp_path: pathlib.Path) -> Iterator[Stream]:
    stream = Stream(tmp_path)
    yield stream
    stream.end()


@pytest.fixture(scope="session")
def root() -> pathlib.Path:
    """The image's root, for a machine in namespaces on the host's kernel; no test may change it."""
    if os.geteuid() != 0:
        pytest.skip("a machine in its own namespaces needs root")
    return build.dev([native.build()]).parent / "root"


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> pathlib.Path:
    """Numbered frames, for the module's SECONDS, or for one second; some modules have another clip."""
    seconds = getattr(request.module, "SECONDS", 1)
    return numbered_clip.write(tmp_path_factory.mktemp("clip") / "clip.y4m", seconds)


@pytest.fixture(scope="session")
def compile_client(tmp_path_factory: pytest.TempPathFactory) -> Compiler:
    return Compiler(tmp_path_factory.mktemp("clients"))
