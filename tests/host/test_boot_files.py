# SPDX-License-Identifier: GPL-2.0-or-later
"""Files that each boot reads lie unpacked in the squashfs, all others packed."""
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
