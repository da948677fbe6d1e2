# SPDX-License-Identifier: GPL-2.0-or-later
"""A second disk for a guest, with a speed limit, which can freeze, fail and be removed.

qemu-nbd serves it, the guest's QEMU limits it. While qemu-nbd is stopped, each request of the guest hangs; after it was
killed, each request fails."""
import dataclasses
import os
import pathlib
import signal
import subprocess
import tempfile
import time

from parts.common import MEMORY, MORTAL, PATIENCE, Closing, Failed, run, wait_until
from parts.guest.qemu import Guest
from parts.processes import kill
DEVICE = "/dev/vdc"  # after the image's disk and the test disk, by its PCI address
# Like the recordings' partition in board/common/disk.cfg
FEATURES = "extents,flex_bg,metadata_csum,64bit,large_file,huge_file,dir_nlink,extra_isize"
OPTIONS = ["-m", "0", "-i", "1048576", "-E", "lazy_itable_init=0,lazy_journal_init=0"]
FILE_SYSTEMS = {"ext4": ["-t", "ext4", "-O", f"^has_journal,{FEATURES}"],
                "ext4-journal": ["-t", "ext4", "-O", f"has_journal,{FEATURES}"],
                "ext3": ["-t", "ext3"]}


def file_system(image: pathlib.Path, megabytes: int, kind: str = "ext4") -> pathlib.Path:
    """Make a file system in a new file."""
    with image.open("wb") as file:
        file.truncate(megabytes << 20)
    run(["mke2fs", "-q", "-F", *FILE_SYSTEMS[kind], *OPTIONS, image])
    return image


@dataclasses.dataclass(frozen=True)
class Speed:
    megabytes: int  # 10^6 bytes a second
    requests: int   # a second


class SlowDisk(Closing):
    """Its content is in `folder`, by default in memory, so that the host's disk does not matter."""

    def __init__(self, megabytes: int, kind: str = "ext4", folder: pathlib.Path = MEMORY) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="ddx-disk-", dir=folder)
        self._socket = pathlib.Path(self._folder.name) / "nbd"
        self.image = file_system(pathlib.Path(self._folder.name) / "disk.img", megabytes, kind)
        self.kind = kind.split("-", maxsplit=1)[0]
        self.process = self._serve()

    def _serve(self) -> subprocess.Popen[bytes]:
        self._socket.unlink(missing_ok=True)
        process = subprocess.Popen([*MORTAL, "qemu-nbd", "--persistent", "--format=raw", f"--socket={self._socket}",
                                    self.image])
        try:
            wait_until(lambda: self._socket.exists() or process.poll() is not None, "qemu-nbd does not start")
            if process.poll() is not None:
                raise Failed(f"qemu-nbd exited with status {process.returncode}")
        except Failed:
            kill(process)
            raise
        return process

    def drive(self) -> tuple[str, ...]:
        """QEMU's options for the guest."""
        file = f"file=nbd+unix:///?socket={self._socket}"
        return ("-drive", f"if=none,id=slow,format=raw,werror=report,rerror=report,{file}",
                "-device", "virtio-blk-pci,id=slow-disk,drive=slow,addr=0x1e")

    def limit(self, guest: Guest, speed: Speed) -> None:
        """Limit the speed from now on."""
        rest = {key: 0 for key in ("bps_rd", "bps_wr", "iops_rd", "iops_wr")}
        guest.monitor("block_set_io_throttle", id="/machine/peripheral/slow-disk/virtio-backend",
                      bps=speed.megabytes * 1_000_000, iops=speed.requests,
                      **rest)

    def mount(self, guest: Guest, place: str = "/rec") -> None:
        """Mount it in place of the image's partition for recordings."""
        guest.sh(f"if mountpoint -q {place}; then umount {place}; fi; "
                 f"mount -t {self.kind} -o noatime,nosuid,nodev,noexec {DEVICE} {place} && "
                 f"chown ddxsave:ddx {place} && chmod 2775 {place}", 60)

    def freeze(self) -> None:
        os.kill(self.process.pid, signal.SIGSTOP)

    def thaw(self) -> None:
        os.kill(self.process.pid, signal.SIGCONT)

    def frozen(self, seconds: float) -> None:
        self.freeze()
        time.sleep(seconds)
        self.thaw()

    def fail(self) -> None:
        """Let each request fail from now on."""
        kill(self.process)
    def end(self) -> None:
        if self.process.poll() is None:
            self.thaw()
            self.process.terminate()
            self.process.wait(PATIENCE)
        self._folder.cleanup()
