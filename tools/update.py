#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""Make and sign an update file from a board's image, or a pair of keys: docs/update.md

update.py file BOARD KEY    output/<board>/ddxvideo-<board>-<version>.update, signed with the secret key
update.py key KEY           the secret key, and beside it the public one, KEY.pub
"""
import pathlib
import sys

from parts.common import OUTPUT, BadInput, Failed, finish, say
from parts.disk import mbr
from parts.release import update_file


def make_file(board: str, key: str) -> None:
    if not board or "/" in board or board.startswith("."):
        raise BadInput("which board? BOARD=name")
    if not key:
        raise BadInput("which key? KEY=file; `make update-key KEY=file` makes one")
    folder = OUTPUT / board
    image, disk = folder / "rootfs.squashfs", folder / "disk.img"
    for path in (image, disk):
        if not path.exists():
            raise BadInput(f"there is no {path}; build the image of {board} first")
    root, what = image.read_bytes(), update_file.release(image)
    slot = mbr.partition(disk, 2)
    with disk.open("rb") as file:
        file.seek(slot.begin)
        if len(root) > slot.end - slot.begin or file.read(len(root)) != root:
            raise Failed(f"{disk} has another root file system than {image}; build the image again")
    if what.board != board:
        raise Failed(f"{image} is for the board {what.board}")
    target = folder / f"ddxvideo-{board}-{what.version.split()[0]}.update"
    target.write_bytes(update_file.make(what, root, pathlib.Path(key).expanduser()))
    say(f"update: {target}: version {what.version}, serial {what.serial}, {target.stat().st_size / 1e6:.1f} MB")


def main() -> int:
    match sys.argv[1:]:
        case ["file", board, key]:
            make_file(board, key)
        case ["key", key] if key:
            public = update_file.make_key(pathlib.Path(key).expanduser())
            say(f"update: {key}: keep it secret. Images trust {public} if they are built with UPDATE_KEYS={public}")
        case ["key", _]:
            raise BadInput("where to? KEY=file")
        case _:
            print(__doc__, file=sys.stderr)
            return 2
    return 0


if __name__ == "__main__":
    finish("update", main)
