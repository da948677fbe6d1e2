# SPDX-License-Identifier: GPL-2.0-or-later
"""The desk build: the packages, each a meson project, installed into output/desk/root, which the image uses as well.
With tests, a package of ours is the subproject of the tree's meson.build."""
import json
import pathlib
import shutil
from collections.abc import Sequence

from parts import defects, trees
from parts.common import HOST_CACHE, OUTPUT, TOP, alone, fingerprint, run, say, step
from parts.image import cyclonedds, dc1394, srtp

PACKAGES = ["ddx", "ddxcatalog", "ddxgrow", "ddxlog", "ddxpanel", "ddxservice", "ddxupdate", "ddxvideo"]  # ours
LIBRARIES = srtp.LIBRARIES
INIT_SCRIPTS = TOP / "board/common/init-scripts"
# Debuggers then find the sources from the top of any clone, also those of an object that another clone compiled.
MAPPED = f"-ffile-prefix-map={TOP}=."
MESON = ["--prefix=/usr", "--sysconfdir=/etc", "--buildtype=debugoptimized", f"-Dc_args={MAPPED}",
         f"-Dcpp_args={MAPPED}"]
# Where ccache is installed, as on each machine that runs the tests, meson uses it: what any build of any clone compiled
# with the same options is not compiled again. Paths are relative, so that clones share.
CCACHE = {"CCACHE_DIR": str(HOST_CACHE / "ccache"), "CCACHE_BASEDIR": str(TOP), "CCACHE_NOHASHDIR": "1",
          "CCACHE_MAXSIZE": "1G"}


def packages() -> list[str]:
    """Our packages, then those of other trees, each after its dependencies."""
    made_of = trees.local_packages()
    others = [name for name, folder in trees.foreign().items() if (folder / "meson.build").exists()]
    return [*PACKAGES, *sorted(others, key=lambda name: (len(made_of.get(name, [])), name))]


def static_library() -> list[str]:
    """gcc's arguments to compile libddx and libddxvideo into a static program for a guest."""
    ddx, video = TOP / "package/ddx", TOP / "package/ddxvideo"
    sources = [path for path in (ddx / "lib").glob("*.c") if path.name != "fault.c"]
    sources += (video / "common").glob("video_*.c")
    return ["-D_GNU_SOURCE", f"-I{ddx}/include", f"-I{video}/include", *map(str, sources)]


def environment(root: pathlib.Path) -> dict[str, str]:
    """The environment in which a package finds the packages that are installed before it."""
    libraries = root / LIBRARIES
    return {"PKG_CONFIG_PATH": str(libraries / "pkgconfig"), "PKG_CONFIG_SYSROOT_DIR": str(root),
            "LD_LIBRARY_PATH": str(libraries)}


def for_run() -> pathlib.Path:
    """The build for `make run`, which shows neither the catalog nor FireWire cameras. Without these and without tests,
    a new machine is ready a minute earlier."""
    chosen = [name for name in packages() if name != "ddxcatalog"]
    return build("run/desk", chosen=chosen, tests=False, firewire=False)


def for_desktop() -> pathlib.Path:
    """The folder with which the packages of `make desktop` are built: the libraries of others, and a ddx that does not
    depend on the prefix. In a clone where the programs were built for tests, those have both."""
    if (OUTPUT / "desk/root/.ddxvideo").exists():
        return build()
    return build("desktop/desk", chosen=["ddx"], libraries_of=PACKAGES, tests=False)


def build(name: str = "desk", options: Sequence[str] = (), chosen: Sequence[str] | None = None,
          tree: pathlib.Path | None = None, libraries_of: Sequence[str] = (), tests: bool = True,
          firewire: bool = True) -> pathlib.Path:
    """Build the chosen packages (None: all) in output/<name>, with these options for meson; returns the install tree.
    `tree`: another copy of our tree; `libraries_of`: packages whose third-party libraries are added, too."""
    root, folders = OUTPUT / name / "root", trees.packages()
    wanted = packages() if chosen is None else chosen
    with alone("build", OUTPUT / f"{name}.lock"):  # tests that run side by side all come here first
        _drop_foreign(OUTPUT / name)
        if (root / "etc/default/store").exists():  # built before release 0.3.0, with other names of programs
            shutil.rmtree(root)
        needed = {*wanted, *libraries_of}
        if "ddxcatalog" in needed:
            _add("cyclonedds", cyclonedds.cyclonedds(), root)
        if "ddxvideo" in needed:
            _add("libsrtp2", srtp.srtp(), root)
            if firewire:
                _add("libdc1394", dc1394.dc1394(), root)
        if tree is None and tests:
            defects.copy()
        for package in wanted:
            sources = tree / "package" / package if tree else folders[package]
            tested = tests and tree is None and package in PACKAGES
            _build(OUTPUT / name / package, root, sources, options, tested)
    return root


def built(name: str, package: str) -> pathlib.Path:
    """Where the package's own programs are in the build with tests; the tests are in output/<name>/<package>/tests."""
    return OUTPUT / name / package / "package" / package


def _drop_foreign(out: pathlib.Path) -> None:
    """Remove packages of trees that EXTERNAL no longer names. Since installed files do not name their package, all
    packages are installed again."""
    record, now = out / "foreign.json", {name: str(folder) for name, folder in trees.foreign().items()}
    before: dict[str, str] = json.loads(record.read_text()) if record.exists() else {}
    gone = [name for name in before if now.get(name) != before[name]]
    for name in ["root", *gone] if gone else []:
        shutil.rmtree(out / name, ignore_errors=True)
    if now != before:
        out.mkdir(parents=True, exist_ok=True)
        record.write_text(json.dumps(now))


def _add(name: str, made: pathlib.Path, root: pathlib.Path) -> None:
    """Add a library to the install tree, where packages find it like ddx."""
    step(f"{root.parent.name}: {name}", root / f".{name}", made.name,
         lambda: shutil.copytree(made, root, dirs_exist_ok=True))


def compile_package(out: pathlib.Path, sources: pathlib.Path, options: Sequence[str], env: dict[str, str]) -> bool:
    """Configure a package where that is needed, and compile it; returns whether anything was compiled."""
    found_in = env.get("PKG_CONFIG_SYSROOT_DIR", "")
    env = {**env, **CCACHE}
    place, words = out / "place", "\n".join([str(out), str(sources), found_in, *MESON, *options])
    # meson and ninja keep absolute paths, also those of other packages: a clone that was moved or copied is configured
    # again, and so is a package that is now built with another install tree.
    if (out / "build.ninja").exists() and not (place.exists() and place.read_text() == words):
        shutil.rmtree(out)
    if not (out / "build.ninja").exists():
        say(f"{out.parent.name}: {out.name}: configuring ...")
        run(["meson", "setup", *MESON, *options, out, sources], env=env)
        place.write_text(words)
    return "ninja: no work to do" not in run(["nice", "-n", "10", "ninja", "-C", out], env=env)


def _build(out: pathlib.Path, root: pathlib.Path, sources: pathlib.Path, options: Sequence[str], tested: bool) -> None:
    title = f"{out.parent.name}: {out.name}"
    env = {**environment(root), "DESTDIR": str(root)}
    stamp = root / f".{out.name}"
    project, words = (TOP, [*options, f"-Dpackage={out.name}"]) if tested else (sources, options)
    if compile_package(out, project, words, env):
        say(f"{title}: built")
        stamp.unlink(missing_ok=True)
    # Only if changed: meson makes the libraries' links again each time, and a program that starts at that moment finds
    # no library.
    def install() -> None:
        run(["meson", "install", "--no-rebuild", "--only-changed", "-C", out], env=env)
        run([INIT_SCRIPTS, sources, root])

    step(f"{title}: installation", stamp, fingerprint([sources, INIT_SCRIPTS]), install)
