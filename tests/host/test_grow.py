# SPDX-License-Identifier: GPL-2.0-or-later
"""ddxgrow on disk images: its changes to the partition table, and its refusals."""
import pathlib
import subprocess

import pytest

from parts.disk import mbr
from parts.image import native

pytestmark = pytest.mark.retry

TABLE = """label: dos
label-id: 0xdd5601de
start=2048, size=2048, type=c, bootable
start=4096, size=90112, type=f
start=6144, size=4096, type=83
start=12288, size=4096, type=83
"""
PROGRAM = native.build() / "usr/sbin/ddxgrow"


def grow(disk: pathlib.Path, number: int) -> subprocess.CompletedProcess[str]:
    return subprocess.run([PROGRAM, disk, str(number)], capture_output=True, text=True, check=False)


def table(disk: pathlib.Path) -> dict[int, tuple[int, int]]:
    return {one["number"]: (one["start"], one["size"]) for one in mbr.table(disk)["partitions"]}


@pytest.fixture
def disk(tmp_path: pathlib.Path) -> pathlib.Path:
    path = tmp_path / "disk"
    path.write_bytes(b"\x5a" * (48 << 20))
    subprocess.run(["/sbin/sfdisk", "-q", path], input=TABLE, text=True, check=True)
    return path


def test_the_last_partition_gets_the_rest_and_nothing_else_changes(disk: pathlib.Path) -> None:
    before, bytes_before = table(disk), disk.read_bytes()
    with disk.open("ab") as file:
        file.truncate(200 << 20)
    assert grow(disk, 6).returncode == 0
    after, end = table(disk), (200 << 20) // 512
    assert after[6] == (before[6][0], end - before[6][0])
    assert after[2] == (before[2][0], end - before[2][0])
    assert {n: after[n] for n in (1, 5)} == {n: before[n] for n in (1, 5)}
    changed = disk.read_bytes()
    tables = {0, 4096 * 512, 10240 * 512}  # sectors with a table: the first, and one before each logical partition
    for begin in range(0, len(bytes_before), 512):
        if begin not in tables:
            assert changed[begin:begin + 512] == bytes_before[begin:begin + 512], begin // 512
    assert changed[:440] == bytes_before[:440]


def test_a_second_run_has_nothing_to_do(disk: pathlib.Path) -> None:
    with disk.open("ab") as file:
        file.truncate(100 << 20)
    assert grow(disk, 6).returncode == 0
    before = disk.read_bytes()
    done = grow(disk, 6)
    assert (done.returncode, "nothing to do" in done.stdout) == (0, True)
    assert disk.read_bytes() == before


def test_a_disk_too_large_for_an_mbr(disk: pathlib.Path) -> None:
    with disk.open("ab") as file:
        file.truncate(3 << 40)
    done = grow(disk, 6)
    assert done.returncode == 0 and "beyond" in done.stdout
    assert 2**32 - 2048 <= mbr.partition(disk, 6).end // 512 < 2**32


@pytest.mark.parametrize("number, reason", [(1, "follows"), (5, "follows"), (2, "extended"), (7, "no such")])
def test_refused_and_unchanged(disk: pathlib.Path, number: int, reason: str) -> None:
    with disk.open("ab") as file:
        file.truncate(100 << 20)
    before = disk.read_bytes()
    done = grow(disk, number)
    assert done.returncode == 1 and reason in done.stderr
    assert disk.read_bytes() == before


def test_refuses_a_missing_table_disk_or_argument(tmp_path: pathlib.Path) -> None:
    empty = tmp_path / "empty"
    empty.write_bytes(bytes(1 << 20))
    assert grow(empty, 6).returncode == 1 and empty.read_bytes() == bytes(1 << 20)
    assert grow(tmp_path / "missing", 6).returncode == 1
    for words in ("", "disk", "disk six", "disk 0", "disk 6 7"):
        assert subprocess.run([PROGRAM, *words.split()], capture_output=True, check=False).returncode == 2
