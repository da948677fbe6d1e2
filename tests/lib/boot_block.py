# SPDX-License-Identifier: GPL-2.0-or-later
"""The boot loader's block of variables, and a boot partition that has one."""
import pathlib

from parts.common import run

BYTES = 1024
HEAD = b"# GRUB Environment Block\n"

Block = dict[str, str]


def text_of(block: Block) -> bytes:
    return (HEAD + "".join(f"{name}={value}\n" for name, value in block.items()).encode()).ljust(BYTES, b"#")


def block_of(text: bytes) -> Block | None:
    """The variables; None: GRUB finds no block."""
    if not text.startswith(HEAD):
        return None
    lines = text.decode("latin1").split("\n")
    return dict(line.split("=", 1) for line in lines if "=" in line and not line.startswith("#"))


def make_fat(path: pathlib.Path, block: Block, *options: str, kilobytes: int = 16384) -> None:
    """A file with a boot partition that has this block."""
    file = path.with_suffix(".grubenv")
    file.write_bytes(text_of(block))
    run(["mkfs.vfat", "-C", "-n", "DDXBOOT", *options, path, str(kilobytes)])
    run(["mmd", "-i", path, "::grub"])
    run(["mcopy", "-i", path, file, "::grub/grubenv"])
