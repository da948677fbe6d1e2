# SPDX-License-Identifier: GPL-2.0-or-later
"""docs/results.md: each long test in a line, with all that it has measured, failed ones as well."""
from typing import Any

import results
from parts.common import TOP


def result(name: str, outcome: str, **figures: Any) -> dict[str, Any]:
    return {"test": f"tests/host/test_results.py::test_{name}", "outcome": outcome, "seconds": 12.3, "commit": "abc",
            "figures": figures}


def test_a_page_tells_all() -> None:
    text = results.page("", [result("it_holds[bios-16 MB]", "passed", lost={"store": 0, "ring": 3}, times=[1, 2.5]),
                             result("it_breaks", "failed")])
    assert "each long test in a line" in text and "make test-long T=test_results" in text
    assert "| it holds (16 MB) | lost: ring 3; times: 1 2.5 | passed | 12 | abc |" in text
    assert "| it breaks | - | failed | 12 | abc |" in text


def test_what_is_not_measured_anew_stays() -> None:
    before = results.page("", [result("it_holds", "passed"), result("it_breaks", "failed")])
    by_hand = "## Again and again\n\nThe suite, 5 times.\n\n## test_results"
    after = results.page(before.replace("## test_results", by_hand), [result("it_breaks", "passed", fault=3)])
    assert "| it holds | - | passed | 12 | abc |" in after and "The suite, 5 times." in after
    assert "| it breaks | fault: 3 | passed | 12 | abc |" in after and "| failed |" not in after
    assert after == results.page(after, [])
