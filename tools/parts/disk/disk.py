# SPDX-License-Identifier: GPL-2.0-or-later
"""The disk of a guest: its writes go to an own file, the image itself stays unchanged."""
import hashlib
import json
import pathlib
import tempfile

from parts.common import PATIENCE, run, scratch

BOOT = 2048 * 512  # the boot partition, see board/common/disk.cfg
BOOT_BYTES = 16 << 20


def digest(image: pathlib.Path) -> str:
    with image.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


class Disk:
    """A qcow2 file over an image, for use while no guest runs; an existing file in the folder is used again. `size`
    (bytes) makes the disk larger than the image."""

    def __init__(self, image: pathlib.Path, folder: pathlib.Path, size: int = 0) -> None:
        self.path = folder / "disk.qcow2"
        if self.path.exists():
            return
        run(["qemu-img", "create", "-q", "-f", "qcow2", "-F", "raw", "-b", image.resolve(), self.path,
             *([str(size)] if size else [])], timeout=PATIENCE)

    def write(self, offset: int, data: bytes) -> None:
        with tempfile.NamedTemporaryFile() as file:
            file.write(data)
            file.flush()
            run(["qemu-io", "-f", "qcow2", "-c", f"write -q -s {file.name} {offset} {len(data)}", self.path],
                timeout=PATIENCE)

    def erase(self, offset: int, length: int) -> None:
        """Fill with zeros."""
        run(["qemu-io", "-f", "qcow2", "-c", f"write -q -z {offset} {length}", self.path], timeout=PATIENCE)

    def read(self, offset: int, length: int) -> bytes:
        with scratch() as folder:
            file = folder / "part"
            source = {"driver": "raw", "offset": offset, "size": length,
                      "file": {"driver": "qcow2", "file": {"driver": "file", "filename": str(self.path)}}}
            run(["qemu-img", "convert", "-O", "raw", f"json:{json.dumps(source)}", file], timeout=PATIENCE)
            return file.read_bytes()

    def set_boot_files(self, files: dict[str, pathlib.Path]) -> None:
        """Write files to the boot partition (name there: contents), as a user does with a card reader."""
        with scratch() as folder:
            partition = folder / "boot"
            partition.write_bytes(self.read(BOOT, BOOT_BYTES))
            for name, file in files.items():
                run(["mcopy", "-o", "-i", partition, file, f"::{name}"])
            self.write(BOOT, partition.read_bytes())
