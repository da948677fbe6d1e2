# SPDX-License-Identifier: GPL-2.0-or-later
"""A stopped campaign continues; it does not mix with results of another build, commit or option."""
import pathlib
from collections.abc import Callable
from typing import Any

import pytest

from parts.testing import campaign
from parts.testing.campaign import Campaign

pytestmark = pytest.mark.retry

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


@pytest.mark.strict
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
