# SPDX-License-Identifier: GPL-2.0-or-later
"""Each of a clip's first frames is recorded or counted as lost, at any number and rate."""
from __future__ import annotations

import json
import pathlib

import pytest

from .programs import Counters, Desk, lost, make_clip, pictures, result, stop, wait_until

pytestmark = pytest.mark.strict

COUNTS = [1, 2, 3, 8, 9, 10, 11, 30]  # around 8, the number that the store keeps for a recorder


@pytest.fixture(scope="module")
def clips(tmp_path_factory: pytest.TempPathFactory) -> dict[int, pathlib.Path]:
    folder = tmp_path_factory.mktemp("clips")
    return {frames: make_clip(folder / f"{frames}.y4m", "176x144", "200", frames) for frames in COUNTS}


def check(desk: Desk, clip: pathlib.Path, loaded: Counters, saved: Counters) -> None:
    """Check that the loader wrote all frames, and the file has all that the recorder did not lose."""
    wanted, found = pictures(clip), pictures(desk.folder / "out.y4m")
    assert loaded["in"] == loaded["out"] == saved["in"] == len(wanted)
    assert saved["out"] == len(found) == len(wanted) - lost(saved)
    at = [wanted.index(picture) for picture in found]
    assert at == sorted(set(at)), "a frame is repeated or out of order"


@pytest.mark.parametrize("rate", ["0", "1", "10"])
def test_a_waiting_recorder(desk: Desk, clips: dict[int, pathlib.Path], rate: str) -> None:
    for frames, clip in clips.items():
        saver = desk.start("ddxvideosave", "-output", "out.y4m", "-name", f"video{frames}", "-instance", f"s{frames}")
        wait_until(lambda: f"s{frames}.stats" in desk.run("ddxctl", "list").stdout)
        loader = desk.run("ddxvideoload", clip, "-rate", rate, "-readers", "1", "-name", f"video{frames}",
                          "-instance", f"l{frames}")
        status, saved = stop(saver)
        assert status == 0 == loader.returncode
        check(desk, clip, json.loads(loader.stdout.splitlines()[-1]), saved)
        if rate == "0":
            assert lost(saved) == 0, "the loader has time, and a reader"


@pytest.mark.parametrize("rate", ["0", "1"])
def test_a_waiting_loader(desk: Desk, clips: dict[int, pathlib.Path], rate: str) -> None:
    """The recorder counts as a reader once frames are kept for it, not when it requests that."""
    for frames, clip in clips.items():
        loader = desk.start("ddxvideoload", clip, "-rate", rate, "-readers", "1", "-name", f"video{frames}",
                            "-instance", f"l{frames}")
        wait_until(lambda: f"video{frames} " in desk.run("ddxctl", "list").stdout)
        saver = desk.start("ddxvideosave", "-output", "out.y4m", "-name", f"video{frames}", "-instance", f"s{frames}")
        status, loaded = result(loader)
        assert status == 0
        status, saved = stop(saver)
        assert status == 0
        check(desk, clip, loaded, saved)
        if rate == "0":
            assert lost(saved) == 0, "the loader has time, and a reader"
