# SPDX-License-Identifier: GPL-2.0-or-later
"""libsrtp2 for the programs of the desk and of the development image, from Debian's source package.

Debian's own library calls NSS, which the product does not have: there libsrtp2 brings its own cryptography, as here. A
static library, so that the programs run without it wherever they are installed.
"""
import os
import pathlib

from parts.common import CACHE, fingerprint, run
from parts.image import foreign
from parts.image.archive import Archive

LIBRARIES = "usr/lib/x86_64-linux-gnu"  # of an install tree


def build(tree: pathlib.Path) -> None:
    source = CACHE / "unpacked/libsrtp2"
    Archive().source("libsrtp2", source)
    run(["./configure", "--prefix=/usr", f"--libdir=/{LIBRARIES}", "--disable-nss", "--disable-openssl",
         "--disable-pcap"], cwd=source)
    run(["make", f"-j{os.cpu_count()}", "libsrtp2.a"], cwd=source)
    run(["make", f"DESTDIR={tree}", "install"], cwd=source)
    run(["rm", "-rf", source])


def srtp() -> pathlib.Path:
    """An install tree: headers, libsrtp2.a and its pkg-config file. Debian's archive is needed the first time only, not
    in each clone: the desk's build works without a network."""
    compiler = run(["dpkg-query", "-W", "-f", "${Package} ${Version}\\n", *foreign.COMPILER])
    return foreign.kept("libsrtp2", fingerprint([pathlib.Path(__file__)], compiler), build)
