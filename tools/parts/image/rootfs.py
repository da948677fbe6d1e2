# SPDX-License-Identifier: GPL-2.0-or-later
"""The development image's root file system, assembled in output/dev/root."""
import os
import pathlib
import re
import shutil
import subprocess

from parts import trees
from parts.common import TOP, commit, entries, run
from parts.image import tables

BOARD = TOP / "board/dev"
COMMON = TOP / "board/common"
HOST_PROGRAMS = BOARD / "host-programs.txt"
SHIPPED = ["etc", "usr/bin", "usr/sbin", "usr/libexec", "usr/lib", "usr/share/ddx"]  # of the packages' install tree
UNWANTED = ["*.a", "*.pc", "*.h", "pkgconfig"]


def libraries(program: pathlib.Path, search: list[pathlib.Path]) -> list[pathlib.Path]:
    """Libraries that a program needs, as ldd finds them."""
    env = {**os.environ, "LD_LIBRARY_PATH": ":".join(map(str, search))}
    text = subprocess.run(["ldd", program], env=env, capture_output=True, text=True, check=False).stdout
    if "not found" in text:
        raise FileNotFoundError(f"{program}: {text}")
    return [pathlib.Path(path) for path in re.findall(r"(/\S+) \(0x", text)]


def _copy(source: pathlib.Path, target: pathlib.Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.copy(source, target)


def _add_users(root: pathlib.Path) -> None:
    users = tables.programs()
    for name, lines in (
            ("passwd", [f"{one.user}:x:{one.number}:{tables.GROUP_NUMBER}:{one.what}:/:/bin/false" for one in users]),
            ("shadow", [f"{one.user}:*:::::::" for one in users]),
            ("group", [f"{tables.GROUP}:x:{tables.GROUP_NUMBER}:"])):
        with (root / "etc" / name).open("a") as file:
            file.writelines(f"{line}\n" for line in lines)


def assemble(root: pathlib.Path, busybox: pathlib.Path, kernel: pathlib.Path, packages: list[pathlib.Path],
             words: dict[str, str] | None = None) -> None:
    """Fill the root, without the kernel's boot files. `words`: more of post-build.sh's environment."""
    shutil.rmtree(root, ignore_errors=True)
    shutil.copytree(BOARD / "skeleton", root, symlinks=True)
    shutil.copytree(busybox, root, symlinks=True, dirs_exist_ok=True)
    shutil.copytree(kernel / "lib", root / "lib", symlinks=True, dirs_exist_ok=True)
    for package in packages:
        for folder in SHIPPED:
            if (package / folder).is_dir():
                shutil.copytree(package / folder, root / folder, symlinks=True, dirs_exist_ok=True,
                                ignore=shutil.ignore_patterns(*UNWANTED))
    for overlay in trees.each("overlay"):  # a file takes the place of a link, and is not written through it
        run(["cp", "-a", "--remove-destination", f"{overlay}/.", root])
    run([COMMON / "post-build.sh", root], env={"DDX_BOARD": "dev", "DDX_COMMIT": commit(), **(words or {})})
    _add_users(root)

    search = [package / folder for package in packages for folder in ["usr/lib/x86_64-linux-gnu", "usr/lib"]]
    programs = [root / "bin/busybox"]
    for name in entries(HOST_PROGRAMS):
        (root / name.lstrip("/")).unlink(missing_ok=True)
        _copy(pathlib.Path(name), root / name.lstrip("/"))
        programs.append(root / name.lstrip("/"))
    for folder in ["usr/bin", "usr/sbin", "usr/lib", "usr/libexec"]:
        programs += [p for p in (root / folder).rglob("*") if p.is_file() and not p.is_symlink()]
    for program in programs:
        if program.open("rb").read(4) != b"\x7fELF":
            continue
        if program.is_relative_to(root / "usr"):
            run(["strip", "--strip-unneeded", program])
        for library in libraries(program, search):
            if not any(library.is_relative_to(package) for package in packages):
                target = root / str(library).lstrip("/")
                if not target.exists():
                    _copy(library, target)


def pack(root: pathlib.Path, image: pathlib.Path) -> None:
    """Make the squashfs; with gzip, since it is built many times a day, and xz takes five times as long."""
    image.unlink(missing_ok=True)
    run(["mksquashfs", root, image, "-comp", "gzip", "-Xcompression-level", "6", "-all-root", "-no-xattrs",
         "-noappend", "-no-progress", "-quiet", "-noI", "-action-file", root.with_name("boot-files.actions")])
