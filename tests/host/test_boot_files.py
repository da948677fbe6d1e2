# SPDX-License-Identifier: GPL-2.0-or-later
"""Files that each boot reads lie unpacked in the squashfs, all others packed; files that nothing needs are missing."""
import pathlib

import pytest

from parts.common import TOP, run
from parts.image import rootfs

pytestmark = pytest.mark.retry

LISTED = ("bin/busybox", "usr/lib/libz.so.1.2", "etc/init.d/S20store", "lib/modules/6.12/modules.dep")
OTHERS = ("usr/bin/ddxdecode", "usr/lib/libpng.so.1", "lib/modules/6.12/kernel/bochs.ko")


def test_listed_files_are_unpacked_and_others_are_packed(tmp_path: pathlib.Path) -> None:
    root, image = tmp_path / "root", tmp_path / "rootfs.squashfs"
    for name in (*LISTED, *OTHERS):
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(f"{name}\n" * 1000)
    run([TOP / "board/common/post-build.sh", root])
    rootfs.pack(root, image)
    found = image.read_bytes()
    assert [name for name in (*LISTED, *OTHERS) if (root / name).read_bytes() in found] == [*LISTED]


def test_a_library_stays_if_a_program_needs_it(tmp_path: pathlib.Path) -> None:
    files = {"lib/libmvec.so.1": "needs libm.so.6", "usr/lib/libnl-nf-3.so.200.26.0": "libnl-nf-3.so.200",
             "usr/bin/filter": "needs libmvec.so.1",
             "lib/modules/6.12/modules.alias": "", "lib/modules/6.12/modules.order": ""}
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    run([TOP / "board/common/post-build.sh", tmp_path])
    assert [name for name in files if (tmp_path / name).exists()] == \
        ["lib/libmvec.so.1", "usr/bin/filter", "lib/modules/6.12/modules.alias"]
    (tmp_path / "usr/bin/filter").unlink()
    run([TOP / "board/common/post-build.sh", tmp_path])
    assert not (tmp_path / "lib/libmvec.so.1").exists()
