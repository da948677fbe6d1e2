# SPDX-License-Identifier: GPL-2.0-or-later
"""Write a disk and read it back, without the page cache; and the image to write."""
import errno
import fcntl
import mmap
import os
import pathlib
import stat

from parts.common import Failed

CHUNK = 4 * 2**20
BLKRRPART = 0x125F  # linux/fs.h
BLKFLSBUF = 0x1261


class Source:
    """The image with replaced parts, followed by zeros."""

    def __init__(self, image: pathlib.Path) -> None:
        self._file = image.open("rb", buffering=0)
        self._parts: list[tuple[int, bytes]] = []

    def replace(self, begin: int, part: bytes) -> None:
        self._parts.append((begin, part))

    def read(self, offset: int, size: int) -> bytes:
        data = bytearray(os.pread(self._file.fileno(), size, offset))
        data += bytes(size - len(data))
        for where, part in self._parts:
            begin, end = max(offset, where), min(offset + size, where + len(part))
            if begin < end:
                data[begin - offset:end - offset] = part[begin - where:end - where]
        return bytes(data)

    def close(self) -> None:
        self._file.close()


def _why(error: OSError) -> str:
    return os.strerror(error.errno) if error.errno else str(error)


class Device:
    """An open disk, locked so that no other program mounts, formats or flashes it."""

    def __init__(self, path: pathlib.Path) -> None:
        self.path = path
        self.is_disk = stat.S_ISBLK(path.stat().st_mode)
        flags = os.O_RDWR | os.O_CLOEXEC | (os.O_EXCL if self.is_disk else 0)
        try:
            try:
                self._fd = os.open(path, flags | os.O_DIRECT)
            except OSError as error:
                if error.errno != errno.EINVAL or self.is_disk:  # not every file system has O_DIRECT
                    raise
                self._fd = os.open(path, flags)
        except OSError as error:
            why = {errno.EBUSY: "is in use by another program",
                   errno.EACCES: "can be written by root only (sudo make flash ...)",
                   errno.EPERM: "cannot be written, not even by root: locked?",
                   errno.EROFS: "is read-only; does the card have a lock?",
                   errno.ENOMEDIUM: "is empty: no card in the reader?"}.get(error.errno or 0)
            raise Failed(f"{path} {why or 'cannot be opened: ' + _why(error)}") from None
        try:  # udev does not probe a locked disk
            fcntl.flock(self._fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(self._fd)
            raise Failed(f"{path} is in use by another program") from None
        self._buffer = mmap.mmap(-1, CHUNK)  # O_DIRECT wants whole pages

    def write(self, offset: int, data: bytes) -> None:
        self._buffer[:len(data)] = data
        done = 0
        with memoryview(self._buffer) as view:
            while done < len(data):
                try:
                    count = os.pwrite(self._fd, view[done:len(data)], offset + done)
                except OSError as error:
                    raise Failed(f"{self.path} cannot be written at byte {offset + done:,}: {_why(error)}") from None
                done += count

    def read(self, offset: int, size: int) -> bytes:
        done = 0
        with memoryview(self._buffer) as view:
            while done < size:
                try:
                    count = os.preadv(self._fd, [view[done:size]], offset + done)
                except OSError as error:
                    raise Failed(f"{self.path} cannot be read at byte {offset + done:,}: {_why(error)}") from None
                if count == 0:
                    raise Failed(f"{self.path} ends at byte {offset + done:,}")
                done += count
        return self._buffer[:size]

    def settle(self) -> None:
        """Wait until all data is on the disk, and drop caches, so that later reads come from the disk."""
        try:
            os.fsync(self._fd)
            if self.is_disk:
                fcntl.ioctl(self._fd, BLKFLSBUF)
            os.posix_fadvise(self._fd, 0, 0, os.POSIX_FADV_DONTNEED)
        except OSError as error:
            raise Failed(f"{self.path} does not finish writing: {_why(error)}") from None

    def reread_partitions(self) -> str:
        """Make the kernel read the partition table; the reason if it fails, else empty."""
        try:
            fcntl.ioctl(self._fd, BLKRRPART)
        except OSError as error:
            return _why(error)
        return ""

    def close(self) -> None:
        os.close(self._fd)
