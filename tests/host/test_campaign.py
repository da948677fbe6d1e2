# SPDX-License-Identifier: GPL-2.0-or-later
"""A stopped campaign continues; it does not mix with results of another build, commit or option."""
import pathlib
from collections.abc import Callable
from typing import Any

import pytest

import bench_record
import buildroot
import crash
import endurance
import killed
import powercut
from parts.guest import machine
from parts.testing import campaign
from parts.testing.campaign import Campaign

Make = Callable[..., Campaign]


@pytest.fixture
def image(tmp_path: pathlib.Path) -> pathlib.Path:
    file = tmp_path / "disk.img"
    file.write_bytes(bytes(4096))
    return file


@pytest.fixture
def make(tmp_path: pathlib.Path, image: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> Make:
    """Start or continue the campaign, at any commit."""
    def make(commit: str = "abc", **options: Any) -> Campaign:
        monkeypatch.setenv("DDX_COMMIT", commit)
        return Campaign(tmp_path / "run.jsonl", [image], [tmp_path / "disk.qcow2", tmp_path / "folder"], **options)
    return make


def change_one_byte(image: pathlib.Path) -> None:
    with image.open("r+b") as file:
        file.seek(2000)
        file.write(b"\1")


def test_steps_are_done_once(make: Make, tmp_path: pathlib.Path) -> None:
    done: list[int] = []

    def step() -> dict[str, int]:
        done.append(len(done))
        return {"n": done[-1]}

    for _ in range(2):
        run = make(seed=1)
        assert [run.once(f"step {number}", step) for number in range(3)] == [{"n": 0}, {"n": 1}, {"n": 2}]
        (tmp_path / "disk.qcow2").touch()
    assert done == [0, 1, 2] and (tmp_path / "disk.qcow2").exists()
    run.add("step 1", "again")
    assert make(seed=1).results == {"step 0": {"n": 0}, "step 1": "again", "step 2": {"n": 2}}


@pytest.mark.parametrize("what", ["image", "commit", "options"])
def test_another_build_starts_over(make: Make, image: pathlib.Path, tmp_path: pathlib.Path, what: str,
                                   capsys: pytest.CaptureFixture[str]) -> None:
    make(seed=1).add("step", {"lost": 0})
    (tmp_path / "disk.qcow2").touch()
    (tmp_path / "folder").mkdir()
    if what == "image":
        change_one_byte(image)
    run = make(seed=2 if what == "options" else 1, commit="def" if what == "commit" else "abc")
    assert not run.results and "starts over" in capsys.readouterr().out
    assert not (tmp_path / "disk.qcow2").exists() and not (tmp_path / "folder").exists()
    run.add("other", {})
    assert list(campaign.read(run.file)[1]) == ["other"]


def test_a_truncated_line_does_not_count(make: Make) -> None:
    run = make()
    run.add("whole", 1)
    with run.file.open("a") as file:
        file.write('{"step": "cut')
    again = make()
    assert again.results == {"whole": 1}
    again.add("next", 2)
    assert make().results == {"whole": 1, "next": 2}


@pytest.mark.parametrize("content", ["", "[]\n", "[1, 2]\n[3]\n", '{"about": {}}\n{"x": 1}\n', "\0\0\n", "3\n"])
def test_an_invalid_results_file_is_replaced(make: Make, tmp_path: pathlib.Path, content: str) -> None:
    (tmp_path / "run.jsonl").write_text(content)
    assert not make().results


@pytest.mark.parametrize("tool, options, leftovers", [
    (bench_record, {"duration": 60}, []),
    (crash, {}, []),
    (endurance, {}, []),
    (killed, {"seed": 1}, ["disk.qcow2"]),
    (powercut, {"cuts": 9, "seed": 1, "naive": False}, ["pool.log"]),
], ids=lambda value: getattr(value, "__name__", ""))
def test_each_tool_starts_over_with_another_image(tool: Any, options: dict[str, Any], leftovers: list[str],
                                                  image: pathlib.Path, tmp_path: pathlib.Path,
                                                  monkeypatch: pytest.MonkeyPatch) -> None:
    """A disk overlay of another image, and the logged writes of another build, cannot be used."""
    monkeypatch.setattr(tool, "WORK", tmp_path)
    run = tool.campaign([image], **options)
    run.add("step", {})
    for name in leftovers:
        (tmp_path / name).touch()
    assert tool.campaign([image], **options).results
    change_one_byte(image)
    assert not tool.campaign([image], **options).results
    assert not any((tmp_path / name).exists() for name in leftovers)


def test_the_first_of_two_builds_is_kept_only_for_the_same_sources(tmp_path: pathlib.Path,
                                                              monkeypatch: pytest.MonkeyPatch) -> None:
    built: list[str] = []
    place = tmp_path / "board"
    (place / "root").mkdir(parents=True)
    monkeypatch.setattr(buildroot, "OUTPUT", tmp_path)

    def build(_: str) -> None:
        built.append("image")
        for name in ("disk.img", "rootfs.squashfs"):
            (place / name).write_bytes(b"1")

    monkeypatch.setattr(buildroot, "image", build)
    monkeypatch.setattr(buildroot, "make", lambda *words, show: built.append(words[-1]))
    monkeypatch.setenv("DDX_COMMIT", "abc")
    sources = ""
    monkeypatch.setattr(machine, "sources", lambda _: sources)
    for sources, expected in (("one", ["image", "clean", "image"]), ("one", ["image"]),
                              ("two", ["image", "clean", "image"])):
        built.clear()
        buildroot.reproduce("board")
        assert built == expected
