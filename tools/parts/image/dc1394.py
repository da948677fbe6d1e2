# SPDX-License-Identifier: GPL-2.0-or-later
"""libdc1394 for the desk's programs and those of the development image, with the product's patches.

Debian has the same version, but not the patches. A static library, as libsrtp2 is; it needs Debian's libusb.
"""
import os
import pathlib

from parts.common import CACHE, TOP, fingerprint, run
from parts.image import foreign, srtp
from parts.image.archive import Archive

PACKAGE = TOP / "package/libdc1394"


def patches() -> list[pathlib.Path]:
    return sorted(PACKAGE.glob("*.patch"))


def build(tree: pathlib.Path, flags: str = "") -> None:
    source = CACHE / "unpacked/libdc1394"
    Archive().source("libdc1394", source)
    for patch in patches():
        run(["patch", "-p1", "-i", patch], cwd=source)
    # FireWire through the kernel, as in the product, also where this machine has libraw1394.
    run(["./configure", "--prefix=/usr", f"--libdir=/{srtp.LIBRARIES}", "--disable-shared", "--disable-examples",
         "--without-x", "--disable-doxygen-doc"], cwd=source,
        env={"ac_cv_lib_raw1394_raw1394_channel_modify": "no", "ac_cv_path_SDL_CONFIG": "no",
             **({"CFLAGS": flags} if flags else {})})
    generated = [f"{tool}=:" for tool in ["ACLOCAL", "AUTOMAKE", "AUTOCONF", "AUTOHEADER"]]  # by its authors, already
    run(["make", f"-j{os.cpu_count()}", *generated], cwd=source)
    run(["make", f"DESTDIR={tree}", *generated, "install"], cwd=source)
    run(["rm", "-rf", source, tree / "usr/bin", tree / "usr/share", tree / srtp.LIBRARIES / "libdc1394.la"])


def dc1394(flags: str = "") -> pathlib.Path:
    """An install tree: headers, libdc1394.a and its pkg-config file; kept as that of libsrtp2 is. `flags` for the
    compiler make another one, such as one with a sanitizer."""
    made_with = run(["dpkg-query", "-W", "-f", "${Package} ${Version}\\n", *foreign.COMPILER, "libusb-1.0-0-dev"])
    key = fingerprint([pathlib.Path(__file__), *patches()], made_with, *([flags] if flags else []))
    return foreign.kept("libdc1394" + ("-flags" if flags else ""), key, lambda tree: build(tree, flags))
