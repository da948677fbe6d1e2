# SPDX-License-Identifier: GPL-2.0-or-later
"""Which version an image is: its /etc/os-release, written by board/common/post-build.sh."""
import pathlib


def parse(text: str) -> dict[str, str]:
    """Its lines, without quotes."""
    return {name: value.strip('"') for name, _, value in (line.partition("=") for line in text.splitlines())}


def os_release(root: pathlib.Path) -> dict[str, str]:
    """Of an unpacked root; empty for an image from before it had the file."""
    path = root / "usr/lib/os-release"
    return parse(path.read_text()) if path.exists() else {}
