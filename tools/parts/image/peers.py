# SPDX-License-Identifier: GPL-2.0-or-later
"""Programs of others that talk to the catalog in tests: ROS 2, a tool of DDS, and what hashes types as ROS does.

PyPI has ROS 2 without a ROS installation. It finds its libraries beside its Python, so it needs an environment of its
own.
"""
import pathlib

from parts.common import TOP, fingerprint, run
from parts.image import foreign

PACKAGES = TOP / "tools/peer-packages.txt"


def make(tree: pathlib.Path) -> None:
    run(["/usr/bin/python3", "-m", "venv", tree])
    run([tree / "bin/python", "-m", "pip", "--quiet", "--disable-pip-version-check", "install", "--no-deps",
         "--no-build-isolation", "--require-hashes", "--requirement", PACKAGES])


def peers() -> pathlib.Path:
    """The environment: bin/python, bin/cyclonedds. The network is needed the first time only."""
    return foreign.kept("peers", fingerprint([PACKAGES, pathlib.Path(__file__)]), make)
