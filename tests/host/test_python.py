# SPDX-License-Identifier: GPL-2.0-or-later
"""The Python modules `ddx` and `ddxvideo`."""
from __future__ import annotations

import pathlib
import re
import subprocess

import pytest

from .programs import TOP, Desk

pytestmark = pytest.mark.retry

CLIENT = pathlib.Path(__file__).with_name("python_client.py")
MODULES = TOP / "package/ddx/python"


@pytest.mark.parametrize("function", re.findall(r"^def (\w+)\(store", CLIENT.read_text(), re.M))
def test_module(desk: Desk, function: str) -> None:
    done = subprocess.run(["/usr/bin/python3", "-B", CLIENT, function], capture_output=True, text=True, timeout=60,
                          check=False, env={**desk.environment, "PYTHONPATH": str(MODULES)})
    assert done.returncode == 0, done.stderr


def test_python_declares_the_struct_of_the_header() -> None:
    def words(text: str) -> list[str]:
        return re.findall(r"\w+|[^\w\s]", text)

    header = (TOP / "package/ddxvideo/include/ddxvideo.h").read_text()
    found = re.search(r"#define DDX_VIDEO_STRUCT_\(SAMPLE, MAX, CHROMA\)(.*?)\n\n", header, re.S)
    assert found
    struct = re.sub(r"/\*.*?\*/|\\", "", found[1], flags=re.S)
    module = re.search(r'DECLARATION = """(.*?)"""', (MODULES / "ddxvideo.py").read_text(), re.S)
    assert module
    declared = module[1].replace("{sample}", "SAMPLE").replace("{luma}", "MAX").replace("{chroma}", "CHROMA")
    assert words(declared) == words(struct)
