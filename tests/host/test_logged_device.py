# SPDX-License-Identifier: GPL-2.0-or-later
"""The disk whose writes are logged is let go of, and its log has all of them."""
import pathlib

import pytest

from parts.disk import blocklog, logged_device
from parts.disk.logged_device import LoggedDevice, lacking

pytestmark = [pytest.mark.computes, pytest.mark.retry]


def test_a_daemon_that_does_not_stop_leaves_a_whole_log(tmp_path: pathlib.Path,
                                                        monkeypatch: pytest.MonkeyPatch) -> None:
    if reason := lacking():
        pytest.skip(reason)
    image = tmp_path / "disk.img"
    image.write_bytes(bytes(1 << 20))
    with LoggedDevice(image) as disk:
        with open(disk.device, "r+b") as file:
            file.write(b"x" * 4096)
        disk.mark(b"y" * 512)
        monkeypatch.setattr(disk.process, "terminate", lambda: None)
        monkeypatch.setattr(logged_device, "STOP", 0.2)
    assert disk.process.returncode == -9 and str(disk.file) not in pathlib.Path("/proc/mounts").read_text()
    assert [entry.data for entry in blocklog.entries(disk.log) if entry.data] == [b"x" * 4096, b"y" * 512]
