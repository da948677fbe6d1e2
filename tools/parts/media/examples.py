# SPDX-License-Identifier: GPL-2.0-or-later
"""Pictures of OpenCV's examples in Debian, unpacked once on this machine."""
import pathlib

from parts.common import fingerprint, run
from parts.image import foreign
from parts.image.archive import Archive

PACKAGE = "opencv-doc"
FOLDER = "./usr/share/doc/opencv-doc/examples/data"
WANTED = ["vtest.avi", "aloe*", "left??.jpg", "right??.jpg"]


def example(name: str) -> pathlib.Path:
    """The file of this name."""
    def make(tree: pathlib.Path) -> None:
        package = Archive().package(PACKAGE)
        tree.mkdir(parents=True)
        unpack = 'deb=$1 tree=$2; shift 2; dpkg-deb --fsys-tarfile "$deb" | ' \
                 'tar -x -C "$tree" --strip-components=7 --wildcards "$@"'
        run(["sh", "-c", unpack, "sh", package, tree, *(f"{FOLDER}/{pattern}" for pattern in WANTED)])
        package.unlink()

    return foreign.kept("examples", fingerprint([], PACKAGE, *WANTED), make) / name
