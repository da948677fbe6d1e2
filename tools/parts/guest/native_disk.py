# SPDX-License-Identifier: GPL-2.0-or-later
"""A file system in memory for a machine on this machine's own kernel, with an optional limit of its speed.

The kernel (cgroups, of either version) limits reads and writes separately, for this process and its children."""
import functools
import os
import pathlib
import tempfile

from parts.common import MEMORY, Closing, Failed, run, wait_until
from parts.guest.slow_disk import Speed, file_system

GROUPS = pathlib.Path("/sys/fs/cgroup")


def present(base: pathlib.Path, controller: str) -> pathlib.Path:
    """The present group of this process, below `base`."""
    lines = (line.split(":", 2) for line in pathlib.Path("/proc/self/cgroup").read_text().splitlines())
    return next((base / path.lstrip("/") for _, names, path in lines if names == controller), base)


def removed(group: pathlib.Path) -> bool:
    """Try to remove a group, which works when it is empty."""
    try:
        group.rmdir()
    except OSError:
        return False
    return True


class NativeDisk(Closing):
    """Mounted at `place`, an existing folder."""

    def __init__(self, megabytes: int, place: pathlib.Path, speed: Speed | None = None) -> None:
        self.place = place
        self._folder = tempfile.TemporaryDirectory(prefix="ddx-disk-", dir=MEMORY)
        self._device = ""
        self._group: pathlib.Path | None = None
        self._before = GROUPS
        self.image = file_system(pathlib.Path(self._folder.name) / "disk.img", megabytes)
        try:
            # Without the page cache, which makes any disk fast.
            self._device = run(["losetup", "--find", "--show", "--direct-io=on", self.image]).strip()
            run(["mount", "-o", "noatime", self._device, place])
            if speed:
                self._limit(speed)
        except BaseException:
            self.end()
            raise

    def _limit(self, speed: Speed) -> None:
        number = pathlib.Path("/sys/class/block", pathlib.Path(self._device).name, "dev").read_text().strip()
        bytes_, requests = speed.megabytes * 1_000_000, speed.requests
        first = (GROUPS / "blkio").exists()
        base = GROUPS / "blkio" if first else GROUPS
        self._group = base / f"ddx-{os.getpid()}"
        try:
            self._before = present(base, "blkio" if first else "")
            self._group.mkdir()
            if first:
                for way in ("read", "write"):
                    (self._group / f"blkio.throttle.{way}_bps_device").write_text(f"{number} {bytes_}")
                    (self._group / f"blkio.throttle.{way}_iops_device").write_text(f"{number} {requests}")
            else:
                (GROUPS / "cgroup.subtree_control").write_text("+io")
                (self._group / "io.max").write_text(
                    f"{number} rbps={bytes_} wbps={bytes_} riops={requests} wiops={requests}")
            (self._group / "cgroup.procs").write_text(str(os.getpid()))
        except OSError as error:
            raise Failed(f"{self._group}: the disk cannot be limited: {error}") from error

    def end(self) -> None:
        if self._group and self._group.exists():
            (self._before / "cgroup.procs").write_text(str(os.getpid()))
            # The last process of a machine exits a moment after its init.
            wait_until(functools.partial(removed, self._group), f"{self._group}: something still runs in it")
        if self.place.is_mount():
            run(["umount", self.place])
        if self._device:
            run(["losetup", "--detach", self._device])
        self._folder.cleanup()
