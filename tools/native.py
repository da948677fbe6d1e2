# SPDX-License-Identifier: GPL-2.0-or-later
"""The packages built on the desk, each a meson project, installed into output/desk/root, which the image uses too."""
import pathlib
from collections.abc import Sequence

from common import OUTPUT, TOP, run, say

PACKAGES = ["ddx", "ddxgrow", "ddxvideo"]
LIBRARIES = "usr/lib/x86_64-linux-gnu"
MESON = ["--prefix=/usr", "--sysconfdir=/etc", "--buildtype=debugoptimized"]


def environment(root: pathlib.Path) -> dict[str, str]:
    """Lets a package find the ones built before it, in the install tree."""
    libraries = root / LIBRARIES
    return {"PKG_CONFIG_PATH": str(libraries / "pkgconfig"), "PKG_CONFIG_SYSROOT_DIR": str(root),
            "LD_LIBRARY_PATH": str(libraries)}


def build(name: str = "desk", options: Sequence[str] = (), packages: Sequence[str] = PACKAGES) -> pathlib.Path:
    """Build packages in output/<name>, with these options for meson; the install tree."""
    root = OUTPUT / name / "root"
    for package in packages:
        out = OUTPUT / name / package
        env = {**environment(root), "DESTDIR": str(root)}
        if not (out / "build.ninja").exists():
            say(f"{name}: {package}: configuring ...")
            run(["meson", "setup", *MESON, *options, out, TOP / "package" / package], env=env)
        if "ninja: no work to do" not in run(["ninja", "-C", out], env=env):
            say(f"{name}: {package}: built")
        run(["meson", "install", "--no-rebuild", "--only-changed", "-C", out], env=env)
    return root
