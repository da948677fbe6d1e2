# SPDX-License-Identifier: GPL-2.0-or-later
"""An image's version: /etc/os-release, written by board/common/post-build.sh."""
import pathlib


def parse(text: str) -> dict[str, str]:
    """The values, without quotes."""
    return {name: value.strip('"') for name, _, value in (line.partition("=") for line in text.splitlines())}


def os_release(root: pathlib.Path) -> dict[str, str]:
    """The values in an unpacked root; empty for an old image without the file."""
    path = root / "usr/lib/os-release"
    return parse(path.read_text()) if path.exists() else {}
