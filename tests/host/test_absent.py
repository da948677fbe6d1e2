# SPDX-License-Identifier: GPL-2.0-or-later
"""Parts that a machine lacks: their tests fail with STRICT=1, except those of downloads while there is no network."""
import os
import subprocess
import sys

import pytest

from parts.common import TOP

from . import absent

pytestmark = pytest.mark.retry

SKIPPED, FAILED = pytest.skip.Exception, pytest.fail.Exception


@pytest.mark.parametrize("strict, network, outcome", [("", True, SKIPPED), ("1", True, FAILED), ("1", False, SKIPPED)])
def test_downloads(monkeypatch: pytest.MonkeyPatch, strict: str, network: bool, outcome: type[Exception]) -> None:
    monkeypatch.setenv("STRICT", strict)
    monkeypatch.setattr(absent, "has_network", lambda: network)
    with pytest.raises(outcome, match="no network" if not network else "no peer: exit status 1"):
        absent.not_made("no peer", "exit status 1")


@pytest.mark.parametrize("strict, outcome", [("", SKIPPED), ("1", FAILED)])
def test_programs_and_modules(monkeypatch: pytest.MonkeyPatch, strict: str, outcome: type[Exception]) -> None:
    monkeypatch.setenv("STRICT", strict)
    absent.need("sh", "dash")
    assert absent.module("sys", "python3") is sys
    with pytest.raises(outcome, match="no no-program: package thing"):
        absent.need("no-program", "thing")
    with pytest.raises(outcome, match="no module no_module: package thing"):
        absent.module("no_module", "thing")


def test_a_machine_without_a_network_is_noticed() -> None:
    alone = ["unshare", "--net", *([] if os.geteuid() == 0 else ["--map-root-user"])]
    look = "from absent import has_network; raise SystemExit(has_network())"
    clean = {name: value for name, value in os.environ.items() if not name.startswith("PIP_")}
    assert subprocess.run([*alone, sys.executable, "-B", "-c", look], check=False,
                          env={**clean, "PYTHONPATH": str(TOP / "tests/host")}).returncode == 0
