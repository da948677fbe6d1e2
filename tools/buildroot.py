#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""Build the product's images with Buildroot.

usage: buildroot.py boards                     list the boards: configs/ddxvideo_<board>_defconfig
       buildroot.py image BOARD                build everything, output/<board>/disk.img
       buildroot.py make BOARD [TARGET|V=...]  make a target of Buildroot: linux-rebuild, legal-info, menuconfig ...
       buildroot.py sdk BOARD                  build a compiler, output/<board>/ddxvideo-<board>-sdk.tar.gz
       buildroot.py reproduce BOARD            build everything twice from nothing, and compare the images
       buildroot.py check                      run Buildroot's check-package on our tree

EXTERNAL=path[:path]     trees outside of ours: docs/programs.md
BUILDROOT=folder         use this checkout of Buildroot; it must be at the pinned commit
BUILDROOT_URL=url        clone Buildroot from there
BUILDROOT_OUTPUT=folder  build there (O=); only the same folder gives the same image
"""
import os
import pathlib
import re
import shutil
import subprocess
import sys

import lint
from parts import common, trees
from parts.common import HOST_CACHE, OUTPUT, TOP, Failed, commit, copy, fingerprint, finish, run, say
from parts.disk import disk
from parts.guest import machine
from parts.image import tables
from parts.release import renew
from parts.testing.campaign import Campaign

COMMIT, RELEASE = "679b9ead7620bbf193620d1ebf56f53c1764d37a", "2026.02.3"
URL = "https://git.buildroot.net/buildroot"


def boards() -> list[str]:
    return sorted(trees.defconfigs())


def _own_checkout() -> pathlib.Path:
    return HOST_CACHE / f"buildroot-{RELEASE}"


def checkout() -> pathlib.Path:
    """Buildroot at the pinned commit, outside of our tree; cloned if it is missing."""
    given = os.environ.get("BUILDROOT")
    folder = pathlib.Path(given).resolve() if given else _own_checkout()
    if not folder.exists() and not given:
        url = os.environ.get("BUILDROOT_URL") or URL
        say(f"Buildroot {RELEASE}: cloning from {url} ...")
        folder.parent.mkdir(parents=True, exist_ok=True)
        part = folder.with_suffix(".part")
        shutil.rmtree(part, ignore_errors=True)
        run(["git", "clone", "--quiet", "--depth", "1", "--branch", RELEASE, url, part])
        part.rename(folder)
    if not (folder / ".git").exists():
        raise Failed(f"{folder} is no checkout of Buildroot")
    found = run(["git", "-C", folder, "rev-parse", "HEAD"]).strip()
    if found != COMMIT:
        raise Failed(f"{folder} is at commit {found}, we are pinned to {COMMIT} ({RELEASE})")
    if run(["git", "-C", folder, "status", "--porcelain", "--untracked-files=no"]).strip():
        raise Failed(f"{folder} has local changes")
    return folder


def present() -> bool:
    """Whether there is a checkout; clones none."""
    return bool(os.environ.get("BUILDROOT")) or _own_checkout().exists()


def environment() -> dict[str, str]:
    """The environment for Buildroot, without the flags of the `make` that called us."""
    return {name: value for name, value in os.environ.items() if name not in ("MAKEFLAGS", "MAKEOVERRIDES", "MFLAGS")}


def output(board: str) -> pathlib.Path:
    given = os.environ.get("BUILDROOT_OUTPUT")
    return pathlib.Path(given).resolve() if given else OUTPUT / board / "buildroot"


def configured(board: str) -> tuple[list[str], dict[str, str]]:
    """Buildroot's command and its environment, with the board's configuration in place."""
    if board not in boards():
        raise Failed(f"no board {board!r}; there are: {' '.join(boards())}")
    tables.programs()  # refuses contradictory tables before anything is built
    external = trees.buildroot().values()
    build = output(board)
    build.mkdir(parents=True, exist_ok=True)
    command = ["make", "-C", str(checkout()), f"O={build}", f"BR2_EXTERNAL={':'.join(map(str, external))}"]
    env = {**environment(), "DDX_BOARD": board, "DDX_COMMIT": commit(),  # for post-build.sh
           **trees.update_words(trees.update_keys())}
    if os.geteuid() == 0:
        env["FORCE_UNSAFE_CONFIGURE"] = "1"  # GNU tar's configure asks for it
    defconfig = trees.defconfigs()[board]
    # Changes made with menuconfig stay until the defconfig or the possible options change.
    stamp = build / ".defconfig"
    choices = [path for tree in external for path in tree.glob("Config*")]
    choices += [path for package in trees.packages().values() for path in package.glob("Config*")]
    key = fingerprint([defconfig, *choices])
    if not (build / ".config").exists() or not stamp.exists() or stamp.read_text() != key:
        run([*command, defconfig.name], env=env)
        stamp.write_text(key)
    return command, env


def make(board: str, *words: str, show: bool = True) -> None:
    """Make a target of Buildroot. Without `show`, all output goes to a log, and only progress lines are printed."""
    command, env = configured(board)
    build = output(board)
    if show:
        if subprocess.run([*command, *words], env=env, check=False).returncode != 0:
            raise Failed(f"Buildroot: {' '.join(words) or 'the build'} failed")
        return
    log = build / "build.log"
    say(f"{board}: building in {build}, all messages in {log.name}")
    with log.open("a") as file, subprocess.Popen([*command, *words], env=env, stdin=subprocess.DEVNULL, text=True,
                                                 stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                                                 errors="replace") as process:
        assert process.stdout
        last: list[str] = []
        for line in process.stdout:
            file.write(line)
            last = [*last[-40:], line]
            if ">>>" in line:
                say(re.sub(r"\x1b\[\d+m", "", line).strip())
    if process.returncode != 0:
        sys.stdout.writelines(last)
        raise Failed(f"Buildroot failed; more in {log}")


def gather(board: str) -> pathlib.Path:
    """Fill output/<board> with the layout of output/dev, so that the same tests use both."""
    place, images = OUTPUT / board, output(board) / "images"
    (place / "kernel/boot").mkdir(parents=True, exist_ok=True)
    config = [path for path in output(board).glob("build/linux-*/.config") if (path.parent / "Kbuild").exists()
              and not path.parent.name.startswith("linux-headers")]
    if len(config) != 1:
        raise Failed(f"{len(config)} kernels were built in {output(board)}, one was expected")
    shutil.copy(config[0], place / "kernel/boot/config")
    for name in ["disk.img", "rootfs.squashfs"]:
        copy(images / name, place / name)
    shutil.rmtree(place / "root", ignore_errors=True)
    run(["unsquashfs", "-quiet", "-no-progress", "-dest", place / "root", place / "rootfs.squashfs"])
    return place / "disk.img"


def image(board: str) -> pathlib.Path:
    """Build the board's image, as far as it is missing or has changed."""
    configured(board)
    build, sources = output(board), machine.sources(board)
    wanted = renew.keys((build / ".config").read_text(), COMMIT, sources)
    first = renew.begin(build, wanted)
    if first:
        say(f"{board}: {' '.join(first)}, because of changes since the last build")
    if first == [renew.CLEAN]:
        make(board, renew.CLEAN, show=False)
        first = renew.begin(build, wanted)
    make(board, *first, "all", show=False)
    renew.end(build, wanted)
    path = gather(board)
    (path.parent / "sources").write_text(sources)
    return path


def sdk(board: str) -> pathlib.Path:
    """Build an archive of Buildroot's compiler with the headers and libraries of all packages."""
    image(board)
    name = f"ddxvideo-{board}-sdk"
    make(board, f"BR2_SDK_PREFIX={name}", "sdk", show=False)
    copy(output(board) / f"images/{name}.tar.gz", OUTPUT / board / f"{name}.tar.gz")
    return OUTPUT / board / f"{name}.tar.gz"


def differences(first: pathlib.Path, second: pathlib.Path) -> list[str]:
    """Files that differ between two unpacked root file systems, or that only one has."""
    return common.output(["diff", "--recursive", "--brief", "--no-dereference", first, second]).splitlines()


def reproduce(board: str) -> str:
    """Check that two builds from nothing in the same folder give the same image; returns its hash. Continues after a
    finished first build of the same sources and commit."""
    place = OUTPUT / board
    kept = place / "first"

    def first_build() -> None:
        image(board)
        shutil.rmtree(kept, ignore_errors=True)
        kept.mkdir()
        for name in ["disk.img", "rootfs.squashfs", "root"]:
            run(["cp", "-a", "--sparse=always", "--reflink=auto", place / name, kept / name])
        make(board, "clean", show=False)

    Campaign(place / "reproduce.jsonl", [], [kept], sources=machine.sources(board)).once("first build", first_build)
    image(board)
    names = ["disk.img", "rootfs.squashfs"]
    if all(disk.digest(kept / name) == disk.digest(place / name) for name in names):
        return disk.digest(place / names[0])
    raise Failed("\n".join(["the two builds differ:", *differences(kept / "root", place / "root")]))


def check(files: list[pathlib.Path] | None = None) -> int:
    """Run Buildroot's style checker on every file of the tree; returns how many files it checks."""
    # Python is lint's task: check-package checks only those files that libmagic recognizes. The tests' patches belong
    # to no package.
    files = sorted(path for path in files or lint.files()
                   if path.suffix != ".py" and path.parent.name not in ("defects", "fuzz"))
    command: list[str | pathlib.Path] = ["/usr/bin/python3", "-B", checkout() / "utils/check-package", "--br2-external"]
    if subprocess.run([*command, "--verbose", "--quiet", *files], check=False).returncode != 0:
        raise Failed("check-package found mistakes, see above")
    return run([*command, "--dry-run", *files]).count(": would run: ")


def main() -> int:
    match sys.argv[1:]:
        case ["boards"]:
            for board in boards():
                say(f"{board:12} {machine.meta(board)['title']}")
        case ["image", board]:
            say(f"image: {image(board).relative_to(TOP)}")
        case ["sdk", board]:
            say(f"sdk: {sdk(board).relative_to(TOP)}")
        case ["reproduce", board]:
            say(f"{board}: both builds gave the same image, {reproduce(board)}")
        case ["make", board, *words]:
            make(board, *words)
        case ["check"]:
            say(f"check-package: {check()} files are fine")
        case _:
            print(__doc__, file=sys.stderr)
            return 2
    return 0


if __name__ == "__main__":
    finish("buildroot", main)
