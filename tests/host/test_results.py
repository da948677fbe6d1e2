# SPDX-License-Identifier: GPL-2.0-or-later
"""output/results.md: one line for each long test with its figures, also for failed tests."""
import pathlib
from typing import Any

import pytest

import results
from parts.common import Failed
from parts.testing.campaign import Campaign


def result(name: str, outcome: str, **figures: Any) -> dict[str, Any]:
    return {"test": f"tests/host/test_results.py::test_{name}", "outcome": outcome, "seconds": 12.3, "figures": figures}


def test_the_page(tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, path in (("OUTPUT", tmp_path), ("TOP", tmp_path), ("LONG", tmp_path / "long"),
                       ("PAGE", tmp_path / "results.md")):
        monkeypatch.setattr(results, name, path)
    monkeypatch.setenv("DDX_COMMIT", "abc")
    with pytest.raises(Failed, match="no results"):
        results.main()
    test = tmp_path / "tests/host/test_results.py"
    test.parent.mkdir(parents=True)
    test.write_text('"""What it is about."""\n')
    Campaign(tmp_path / "killed/killed.jsonl", [], seed=3).add("kill 0", {})
    (tmp_path / "other.jsonl").write_text('{"test": 1}\n')
    run = Campaign(tmp_path / "long/miniitx.jsonl", [])
    run.add("holds", result("it_holds[bios-16 MB]", "passed", lost={"store": 0, "ring": 3}, times=[1, 2]))
    run.add("breaks", result("it_breaks", "failed"))
    run.add("breaks", result("it_breaks", "passed", fault=3))
    results.main()
    text = (tmp_path / "results.md").read_text()
    assert "| killed/killed.jsonl | abc | seed 3 | 1 |" in text and "other.jsonl" not in text
    assert "## test_results (miniitx, abc)\n\nWhat it is about.\n\n    make test-long BOARD=miniitx " in text
    assert "| it holds (bios-16 MB) | lost: ring 3; times: 1 2 | passed | 12 |" in text
    assert "| it breaks | fault: 3 | passed | 12 |" in text and "| failed |" not in text
