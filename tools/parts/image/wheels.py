# SPDX-License-Identifier: GPL-2.0-or-later
"""Python packages that Debian lacks, for the tests only: pinned, checked, unpacked."""
import hashlib
import pathlib
import zipfile
from collections.abc import Sequence

from parts.common import Failed, fingerprint, run, scratch
from parts.image import foreign

MCAP = {"mcap==1.6.0": "7cd37fba2cf51d033f2139ca837d2ed3024dcec3cd9f8ecdf3d4d15930df6e17",
        "mcap-ros2-support==0.6.0": "0b5f86c88432a1370b6c8f0e8a26d1403dc02495d751052e3dd9f9a0679645ef"}
SKIMAGE = {"scikit-image==0.16.2": "2aa962aa82d815606d7dad7f045f5d7ca55c65b4320d47e15a98fc92612c2d6c"}
# Its wheels are for a Python that Debian does not have any more.
PYTHON_37 = ["--python-version=3.7", "--implementation=cp", "--abi=cp37m", "--platform=manylinux1_x86_64"]


def download(wheel: str, into: pathlib.Path, options: Sequence[str] = ()) -> pathlib.Path:
    run(["/usr/bin/python3", "-m", "pip", "--quiet", "download", "--no-deps", "--only-binary=:all:", *options,
         "--dest", into, wheel])
    return next(into.glob("*.whl"))


def folder(wheels: dict[str, str], options: Sequence[str] = (), parts: str = "") -> pathlib.Path:
    """A folder for sys.path with these packages (name and version: SHA-256 of the wheel). `options`: for pip; `parts`:
    only files whose names begin with this."""
    def make(tree: pathlib.Path) -> None:
        with scratch() as down:
            for number, (wheel, digest) in enumerate(wheels.items()):
                file = download(wheel, down / str(number), options)
                if hashlib.sha256(file.read_bytes()).hexdigest() != digest:
                    raise Failed(f"{file.name} is not the one expected")
                with zipfile.ZipFile(file) as archive:
                    archive.extractall(tree, [name for name in archive.namelist() if name.startswith(parts)])

    return foreign.kept("wheels", fingerprint([], repr(wheels), *([parts] if parts else [])), make)
