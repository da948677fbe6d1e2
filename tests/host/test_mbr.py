# SPDX-License-Identifier: GPL-2.0-or-later
"""Positions of a disk's primary and logical partitions."""
import os
import pathlib
import subprocess

import pytest

from parts.common import SBIN, Failed
from parts.disk import mbr
from parts.disk.mbr import Partition

pytestmark = pytest.mark.retry

LAYOUT = """label: dos
1 : start=2048, size=32768, type=c
4 : start=296960, type=f
5 : start=299008, size=131072
"""


@pytest.mark.parametrize("name", ["disk.img", "disk-1"])  # sfdisk inserts a `p` after a final digit
def test_partitions(tmp_path: pathlib.Path, name: str) -> None:
    disk = tmp_path / name
    disk.touch()
    os.truncate(disk, 1 << 30)
    with pytest.raises(Failed, match="no partition table"):
        mbr.partitions(disk)
    subprocess.run(["sfdisk", "-q", disk], input=LAYOUT, text=True, check=True, env={**os.environ, **SBIN})
    assert mbr.partitions(disk) == [Partition(1, 2048 * 512, 34816 * 512), Partition(5, 299008 * 512, 430080 * 512)]
    with pytest.raises(Failed, match="no partition 4"):
        mbr.partition(disk, 4)
