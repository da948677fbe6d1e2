# SPDX-License-Identifier: GPL-2.0-or-later
"""After random events to writer, recorder and disk, every written frame is in a file or counted with a reason."""
from __future__ import annotations

import concurrent.futures
import pathlib

import pytest

from .events import play, write_clips

pytestmark = pytest.mark.retry

SEEDS = range(20)
RED = ()  # seeds that found a defect
SIDE_BY_SIDE = 4  # scripts in parallel: they mostly wait


def play_all(seeds: list[int], folder: pathlib.Path) -> None:
    clips = write_clips(folder)
    with concurrent.futures.ThreadPoolExecutor(SIDE_BY_SIDE) as pool:
        played = {seed: pool.submit(play, seed, folder, clips) for seed in seeds}
    wrong = [str(error) for seed in seeds if (error := played[seed].exception())]
    assert not wrong, f"{len(wrong)} of {len(seeds)} seeds:\n" + "\n\n".join(wrong[:5])


def test_random_scripts_of_events(tmp_path: pathlib.Path) -> None:
    play_all([*SEEDS, *RED], tmp_path)


@pytest.mark.long
def test_many_random_scripts_of_events(tmp_path: pathlib.Path) -> None:
    play_all(list(range(100, 2100)), tmp_path)
