# SPDX-License-Identifier: GPL-2.0-or-later
"""Parts that a test needs and this machine lacks: the test is skipped, and fails with STRICT=1, since a test that never
runs finds nothing. Without a network, what must be downloaded is absent in each case: then it is skipped."""
from __future__ import annotations

import functools
import importlib
import os
import shutil
import subprocess
import sys
from typing import Any, NoReturn

import pytest


def not_installed(what: str) -> NoReturn:
    if os.environ.get("STRICT"):
        pytest.fail(f"{what} (STRICT: not skipped)", pytrace=False)
    pytest.skip(what)


@functools.cache
def has_network() -> bool:
    """Whether pip finds a package that the tests use. Without pip, the network is not the cause."""
    pip = [sys.executable, "-m", "pip"]
    if subprocess.run([*pip, "--version"], capture_output=True, check=False).returncode:
        return True
    looked = subprocess.run([*pip, "index", "versions", "--retries", "0", "mcap"], capture_output=True, check=False)
    return looked.returncode == 0


def not_made(what: str, error: object) -> NoReturn:
    """For what is downloaded, and perhaps built from that."""
    if has_network():
        not_installed(f"{what}: {error}")
    pytest.skip(f"no network: {what}")


def need(program: str, package: str) -> None:
    if not shutil.which(program):
        not_installed(f"no {program}: package {package}")


def module(name: str, package: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError:
        not_installed(f"no module {name}: package {package}")
