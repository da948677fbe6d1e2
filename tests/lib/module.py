# SPDX-License-Identifier: GPL-2.0-or-later
"""A kernel module of ours for the development image's kernel, built with Debian's headers. Tests alone use it: it goes
onto a test disk, no image holds it."""
import pathlib
import re
import shutil

from parts.common import OUTPUT, Failed, alone, fingerprint, run, step
from parts.image import foreign, kernel
from parts.image.archive import Archive


def _packages() -> list[str]:
    """Those with the headers; the first one has the configuration and Module.symvers."""
    found = re.fullmatch(r"linux-image-(\S+)-(\w+)", kernel.package())
    if not found:
        raise Failed(f"{kernel.package()}: no kernel whose headers are known")
    version, processor = found.groups()
    return [f"linux-headers-{version}-{processor}", f"linux-headers-{version}-common", f"linux-kbuild-{version}"]


def headers() -> pathlib.Path:
    """The folder for make -C."""
    archive, names = Archive(), _packages()

    def unpack(tree: pathlib.Path) -> None:
        for name in names:
            run(["dpkg-deb", "-x", archive.package(name), tree])
        makefile = tree / "usr/src" / names[0] / "Makefile"  # the one file with an absolute path
        makefile.write_text(makefile.read_text().replace("include /usr/src", f"include {tree}/usr/src"))

    tree = foreign.kept("kernel-headers", fingerprint([pathlib.Path(__file__)], *names), unpack)
    return tree / "usr/src" / names[0]


def module(sources: pathlib.Path, name: str) -> pathlib.Path:
    """The module that the folder's Kbuild makes under that name, built now or before."""
    tree, out = headers(), OUTPUT / "dev/modules" / name

    def build() -> None:
        shutil.rmtree(out, ignore_errors=True)
        shutil.copytree(sources, out)
        run(["make", "-C", tree, f"M={out}", "CONFIG_DEBUG_INFO_BTF_MODULES=", "W=1", "KCFLAGS=-Werror", "modules"])

    with alone("build", OUTPUT / "dev/modules.lock"):
        step(f"module {name}", out.with_suffix(".stamp"), fingerprint([sources], str(tree)), build)
    return out / f"{name}.ko"
