# SPDX-License-Identifier: GPL-2.0-or-later
"""Configure Buildroot's BusyBox like the development image's. usage:
python3 -m parts.image.buildroot_busybox SOURCE MAKE...

MAKE... is the command for this source's make. Buildroot calls this during a build: it needs only Python.
"""
import pathlib
import sys

from parts.common import finish
from parts.image import busybox


def main() -> int:
    if len(sys.argv) < 3:
        print(__doc__, file=sys.stderr)
        return 2
    busybox.configure(pathlib.Path(sys.argv[1]), sys.argv[2:])
    return 0


if __name__ == "__main__":
    finish("busybox", main)
