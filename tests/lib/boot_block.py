# SPDX-License-Identifier: GPL-2.0-or-later
"""The boot loader's block of variables, what its menu makes of them, and a boot partition that has a block. The part of
grub.cfg that chooses a slot is close enough to shell syntax to run in a shell."""
import pathlib
import re
import subprocess

from parts.common import TOP, run

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


def menu(block: Block) -> tuple[Block, str, str]:
    """The block after GRUB's menu, the slot that it boots, and the count that it reports."""
    text = (TOP / "board/common/grub.cfg").read_text()
    choice = text[text.index("set slot=A\n"):text.index('if [ "$slot" = B ]; then set partition=')]
    known = "; ".join(f"{name}={value}" for name, value in block.items())
    script = (f"load_env() {{ :; {known}; }}\n" if known else "load_env() { :; }\n") + (
        'save_env() { for name; do eval "echo $name=\\${$name-}"; done; }\n'
        + re.sub(r"\bset (\w+)=", r"\1=", choice) + 'echo "boot $slot $counted"\n')
    done = subprocess.run(["sh", "-c", script], check=True, capture_output=True, text=True)
    assert not done.stderr
    *saved, last = done.stdout.splitlines()
    now = {**block, **dict(line.split("=") for line in saved)}
    _, slot, *counted = last.split()
    return {name: value for name, value in now.items() if value}, slot, "".join(counted)
