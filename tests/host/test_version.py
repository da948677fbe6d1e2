# SPDX-License-Identifier: GPL-2.0-or-later
"""Versions: one number in the whole tree, and the same text from the image and its programs."""
import os
import pathlib
import re
import subprocess

import pytest

from parts.common import TOP, commit, run
from parts.release import version

from .programs import ROOT

pytestmark = pytest.mark.retry


def number() -> str:
    found = re.search(r"^  version: '(.*)',$", (TOP / "package/ddx/meson.build").read_text(), re.M)
    assert found
    return found[1]


def image(root: pathlib.Path, **words: str) -> dict[str, str]:
    run([TOP / "board/common/post-build.sh", root], env=words)
    assert (root / "etc/os-release").read_text() == (root / "usr/lib/os-release").read_text()
    return version.os_release(root)


def test_one_number_everywhere() -> None:
    for path in [*TOP.glob("package/*/meson.build"), TOP / "package/ddx/python/pyproject.toml"]:
        found = re.search(r"^ *version(?:: '| = \")([0-9.]+)['\"],?$", path.read_text(), re.M)
        assert found and found[1] == number(), path
    for path in TOP.glob("package/*/*.mk"):
        text = path.read_text()
        assert "_SITE_METHOD = local" not in text or "VERSION = $(DDX_VERSION)" in text or "/meson.build)" in text, path
    entries = re.findall(r"^## (.*)$", (TOP / "CHANGELOG.md").read_text(), re.M)
    assert [entry for entry in entries if entry != "Not released yet"][0] == number()


def test_an_image_contains_its_version(tmp_path: pathlib.Path) -> None:
    found = image(tmp_path, DDX_COMMIT="v9-1-gabc", DDX_BOARD="miniitx", BR2_VERSION="2026.02.3")
    assert found["VERSION"] == f"{number()} (v9-1-gabc, miniitx, Buildroot 2026.02.3)"
    assert (found["ID"], found["BUILD_ID"], found["VARIANT_ID"]) == ("ddxvideo", "v9-1-gabc", "miniitx")
    assert (found["DDX_LAYOUT"], found["DDX_OLDEST"]) == ("1", "0") and int(found["DDX_SERIAL"]) > 0
    assert f"ddx.layout={found['DDX_LAYOUT']} " in (TOP / "board/common/grub.cfg").read_text()
    first = (tmp_path / "usr/lib/os-release").read_bytes()
    image(tmp_path, DDX_COMMIT="v9-1-gabc", DDX_BOARD="miniitx", BR2_VERSION="2026.02.3")
    assert (tmp_path / "usr/lib/os-release").read_bytes() == first
    assert image(tmp_path, DDX_COMMIT="", DDX_BOARD="dev")["BUILD_ID"] == (commit() or "unknown")


def test_programs_print_their_image_s_version(tmp_path: pathlib.Path) -> None:
    if os.geteuid() != 0:
        pytest.skip("a mount needs root")
    found = image(tmp_path, DDX_COMMIT="v9-1-gabc", DDX_BOARD="dev")
    script = 'mount --bind "$0" "$(readlink -f /etc/os-release)" && for name; do "$name" -version; done'
    names = ["ddxctl", "ddxstore", "ddxvideosave", "ddxrecordings"]
    done = subprocess.run(["unshare", "--mount", "sh", "-c", script, tmp_path / "usr/lib/os-release",
                           *(ROOT / "bin" / name for name in names)], check=True, capture_output=True, text=True)
    assert done.stdout == "".join(f"{name} {number()}\nimage: {found['VERSION']}\n" for name in names)
