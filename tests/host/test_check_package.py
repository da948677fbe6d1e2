# SPDX-License-Identifier: GPL-2.0-or-later
"""Buildroot's own style checker on our tree."""
import pathlib

import buildroot
import lint
import pytest
from parts.common import TOP, Failed

pytestmark = [pytest.mark.retry, pytest.mark.computes, pytest.mark.skipif(not buildroot.present(), reason=(
    "no checkout of Buildroot, neither BUILDROOT= nor one made by `make image`: check-package judged nothing of ours"))]

FAULTS = {
    "package/libdc1394/libdc1394.mk": ("CONF_OPTS = ", "CONF_OPTS = \\\n    "),
    "package/ddx/Config.in": ("\tbool", "        bool"),
    "overlay/etc/init.d/S10mdev": ('DAEMON="mdev"', ""),
    "package/libdc1394/libdc1394.hash": ("sha256  ", "sha256 "),
    "overlay/etc/init.d/S02base": ("\tprintf", "    printf"),
    "overlay/etc/init.d/rcS": ("\n", " \n"),
    "buildroot-external/configs/ddxvideo_pc104_defconfig": ("BR2_DOWNLOAD_FORCE_CHECK_HASHES=y\n", ""),
    "buildroot-external/Config.in": ("\thelp", "\thelp\n\n\n"),
    "board/common/post-image.sh": ("#!/bin/sh\n", "#!/bin/sh\nrm $1\n"),
}


def test_the_tree_is_clean() -> None:
    scripts = [path for path in lint.files() if lint.is_script(path)]
    assert buildroot.check() > len(scripts)


def test_faults_are_found(tmp_path: pathlib.Path, capfd: pytest.CaptureFixture[str]) -> None:
    """One fault of each kind."""
    for name, (good, bad) in FAULTS.items():
        text = (TOP / name).read_text()
        assert good in text
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text.replace(good, bad, 1))
    with pytest.raises(Failed):
        buildroot.check([tmp_path / name for name in FAULTS])
    report = capfd.readouterr().out
    assert [name for name in FAULTS if f"{tmp_path / name}:" not in report] == []
