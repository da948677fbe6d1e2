# SPDX-License-Identifier: GPL-2.0-or-later
"""Shared by all tools and tests: one run at a time, and programs that exit with the process that started them."""
from __future__ import annotations

import os
import pathlib
import shutil
import signal
import subprocess
import sys

import pytest

from parts.common import TOP, Failed
from parts.image import foreign, native

from .programs import wait_until

pytestmark = pytest.mark.retry

ALONE = """
import pathlib, sys
from parts.common import alone, say
with alone("tool", pathlib.Path(sys.argv[1])):
    say("in")
    sys.stdin.read()
"""
DESK = """
import pathlib, sys
from host.programs import Desk
desk = Desk(pathlib.Path(sys.argv[1]))
print(desk.store.pid, flush=True)
sys.stdin.read()
"""


def start(code: str, *arguments: object) -> subprocess.Popen[str]:
    return subprocess.Popen([sys.executable, "-B", "-c", code, *map(str, arguments)], stdin=subprocess.PIPE, text=True,
                            stdout=subprocess.PIPE, env={**os.environ, "PYTHONPATH": f"{TOP}/tools:{TOP}/tests"})


def line(process: subprocess.Popen[str]) -> str:
    assert process.stdout
    return process.stdout.readline().rstrip("\n")


def test_a_second_run_waits_for_the_first(tmp_path: pathlib.Path) -> None:
    lock = tmp_path / "folder/lock"
    first = start(ALONE, lock)
    assert line(first) == "in"
    second = start(ALONE, lock)
    assert line(second) == f"tool: waiting for process {first.pid}, which runs already ({lock})"
    first.kill()  # however it stops
    first.communicate()
    assert line(second) == "in"
    second.communicate()
    third = start(ALONE, lock)
    assert line(third) == "in"
    third.communicate()


TESTS = """
import pytest
pytestmark = pytest.mark.retry
def test_good(tmp_path):
    (tmp_path / "clip").write_text("large")
def test_bad(tmp_path):
    (tmp_path / "clip").write_text("evidence")
    assert tmp_path.name == what
"""


@pytest.mark.parametrize("what, kept", [("test_bad0", []), ("something", ["evidence"])])
def test_only_files_of_failed_tests_are_kept(tmp_path: pathlib.Path, what: str, kept: list[str]) -> None:
    folder, temporary = tmp_path / "tests", tmp_path / "temporary"
    folder.mkdir()
    temporary.mkdir()
    shutil.copy(TOP / "tests/conftest.py", folder)
    (folder / "test_it.py").write_text(f"what = {what!r}\n{TESTS}")
    environment = {**os.environ, "PYTEST_DEBUG_TEMPROOT": str(temporary), "DDX_RESULTS": ""}
    done = subprocess.run([sys.executable, "-B", "-m", "pytest", "-c", TOP / "pytest.ini", folder], cwd=TOP, text=True,
                          env=environment, capture_output=True, check=False)
    assert done.returncode == bool(kept), done.stdout
    assert [file.read_text() for file in temporary.rglob("clip") if "current" not in str(file)] == kept


def test_programs_are_killed_with_their_starter(tmp_path: pathlib.Path) -> None:
    """Otherwise a store would survive its killed test."""
    test = start(DESK, tmp_path)
    store = int(line(test))
    assert pathlib.Path(f"/proc/{store}/comm").read_text() == "ddxstore\n"
    test.send_signal(signal.SIGKILL)
    test.communicate()
    wait_until(lambda: not pathlib.Path(f"/proc/{store}").exists())


def test_unchanged_files_are_not_installed_again() -> None:
    """Parallel test processes all build first, while the others start programs."""
    link = native.build() / native.LIBRARIES / "libddx.so.0"
    before = link.lstat().st_ino, link.lstat().st_ctime_ns
    native.build()
    assert (link.lstat().st_ino, link.lstat().st_ctime_ns) == before


def test_a_shared_cache_is_made_once_per_machine(tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Once for all clones; again with another key, and after an interruption."""
    monkeypatch.setattr(foreign, "HOST_CACHE", tmp_path)
    made: list[str] = []

    def make(tree: pathlib.Path) -> None:
        tree.mkdir()
        made.append(tree.name)

    def cut_short(tree: pathlib.Path) -> None:
        make(tree)
        raise Failed("no space left")

    with pytest.raises(Failed):
        foreign.kept("tool", "first", cut_short)
    trees = [foreign.kept("tool", key, make) for key in ("first", "first", "second")]
    assert made == ["tool-first", "tool-first", "tool-second"] and all(tree.is_dir() for tree in trees)


def test_a_clone_that_was_moved_or_copied_is_built_again(tmp_path: pathlib.Path) -> None:
    """meson and ninja keep absolute paths."""
    clone = tmp_path / "clone"
    (clone / "package").mkdir(parents=True)
    (clone / "package/meson.build").write_text("project('tiny', 'c')\nexecutable('tiny', 'main.c')\n")
    (clone / "package/main.c").write_text("int main(void) { return 0; }\n")

    def compiled(tree: pathlib.Path) -> bool:
        return native.compile_package(tree / "output/tiny", tree / "package", [], {})

    assert compiled(clone) and not compiled(clone)
    shutil.copytree(clone, tmp_path / "copy")
    clone.rename(tmp_path / "moved")
    for tree in tmp_path / "copy", tmp_path / "moved":
        assert compiled(tree) and not compiled(tree)
        subprocess.run([tree / "output/tiny/tiny"], check=True)
