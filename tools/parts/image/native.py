# SPDX-License-Identifier: GPL-2.0-or-later
"""The packages built on the desk, each a meson project, installed into output/desk/root, which the image uses too."""
import pathlib
from collections.abc import Sequence

from parts.common import OUTPUT, TOP, alone, fingerprint, run, say, step

PACKAGES = ["ddx", "ddxgrow", "ddxlog", "ddxservice", "ddxvideo"]
LIBRARIES = "usr/lib/x86_64-linux-gnu"
MESON = ["--prefix=/usr", "--sysconfdir=/etc", "--buildtype=debugoptimized"]


def static_library() -> list[str]:
    """For gcc: libddx and libddxvideo as sources, in a static program that a guest runs."""
    ddx, video = TOP / "package/ddx", TOP / "package/ddxvideo"
    sources = [path for path in (ddx / "lib").glob("*.c") if path.name != "fault.c"]
    sources += (video / "common").glob("video_*.c")
    return ["-D_GNU_SOURCE", f"-I{ddx}/include", f"-I{video}/include", *map(str, sources)]


def environment(root: pathlib.Path) -> dict[str, str]:
    """Lets a package find the ones built before it, in the install tree."""
    libraries = root / LIBRARIES
    return {"PKG_CONFIG_PATH": str(libraries / "pkgconfig"), "PKG_CONFIG_SYSROOT_DIR": str(root),
            "LD_LIBRARY_PATH": str(libraries)}


def build(name: str = "desk", options: Sequence[str] = (), packages: Sequence[str] = PACKAGES,
          tree: pathlib.Path = TOP) -> pathlib.Path:
    """Build packages of the tree in output/<name>, with these options for meson; the install tree."""
    root = OUTPUT / name / "root"
    with alone("build", OUTPUT / f"{name}.lock"):  # tests that run side by side all come here first
        for package in packages:
            _build(OUTPUT / name / package, root, tree, options)
    return root


def _build(out: pathlib.Path, root: pathlib.Path, tree: pathlib.Path, options: Sequence[str]) -> None:
    title, sources = f"{out.parent.name}: {out.name}", tree / "package" / out.name
    env = {**environment(root), "DESTDIR": str(root)}
    if not (out / "build.ninja").exists():
        say(f"{title}: configuring ...")
        run(["meson", "setup", *MESON, *options, out, sources], env=env)
    stamp = root / f".{out.name}"
    if "ninja: no work to do" not in run(["nice", "-n", "10", "ninja", "-C", out], env=env):
        say(f"{title}: built")
        stamp.unlink(missing_ok=True)
    # Only what is not there yet: meson makes the libraries' links anew each time, and who starts in that moment finds
    # no library.
    step(f"{title}: installation", stamp, fingerprint([sources]),
         lambda: run(["meson", "install", "--no-rebuild", "--only-changed", "-C", out], env=env))
