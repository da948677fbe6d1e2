# SPDX-License-Identifier: GPL-2.0-or-later
"""Find out which parts of an earlier build in Buildroot's folder must be built again, from hashes of their sources.

Buildroot itself does not check this. Changes that it cannot build incrementally (toolchain, options of packages) need a
build from nothing. Packages that our tree downloads and patches are used by packages of the trees only, so that these
are built again with them. The target folder is filled again, so that it contains no file that the tree no longer has.
"""
import json
import pathlib
import re
import shutil

from parts import trees
from parts.common import TOP, fingerprint

CLEAN, TARGET = "clean", "target"
# Options for files of ours, which are hashed themselves, for steps that each build repeats, and the tree's commit.
NAMES_FILES = re.compile(r"BR2_(ROOTFS_(OVERLAY|POST_\w+_SCRIPT|DEVICE_TABLE)|GLOBAL_PATCH_DIR|PACKAGE_BUSYBOX_CONFIG|"
                         r"LINUX_KERNEL_(CUSTOM_CONFIG_FILE|CONFIG_FRAGMENT_FILES)|DL_DIR|JLEVEL|DEFCONFIG|"
                         r"EXTERNAL_\w+_VERSION)=")
KERNEL = re.compile(r'^BR2_LINUX_KERNEL_(?:CUSTOM_CONFIG_FILE|CONFIG_FRAGMENT_FILES)="(.*)"$', re.M)
FFMPEG = "BR2_PACKAGE_FFMPEG_"
BUSYBOX = ["board/common/busybox.config", "board/common/manifest.txt", "tools/parts/image/buildroot_busybox.py",
           "tools/parts/image/busybox.py"]


def _kernel_files(config: str) -> list[pathlib.Path]:
    text = " ".join(KERNEL.findall(config))
    for name, tree in trees.buildroot().items():
        text = text.replace(f"$(BR2_EXTERNAL_{name}_PATH)", str(tree))
    return [pathlib.Path(name).resolve() for name in text.split()]


def keys(config: str, commit: str, sources: str) -> dict[str, str]:
    """A hash for each target of Buildroot (including CLEAN), and for the target folder. `config`: Buildroot's .config,
    `commit`: Buildroot's, `sources`: hash of all our sources for the image."""
    options = [line for line in config.splitlines() if line.startswith("BR2_") and not NAMES_FILES.match(line)]
    ffmpeg = [line for line in options if line.startswith(FFMPEG)]
    folders, foreign, local = trees.packages(), trees.foreign(), trees.local_packages()
    patched = {name: folder for name, folder in folders.items() if name not in local and name not in foreign}
    other = [folder for name, folder in foreign.items() if name not in local]
    # An image has all our packages; the board's configuration may leave out packages of other trees.
    made = [name for name in local
            if name not in foreign or f"BR2_PACKAGE_{name.upper().replace('-', '_')}=y" in options]
    makefiles = [tree / "external.mk" for tree in trees.buildroot().values()]
    patches = [path for folder in trees.each("board/common/patches") for path in sorted(folder.rglob("*.patch"))]
    whole = [*makefiles, *other, *patches]
    return {CLEAN: fingerprint(whole, commit, *(line for line in options if line not in ffmpeg)),
            TARGET: fingerprint([], commit, sources, *options),
            **{f"{name}-dirclean": fingerprint([folder]) for name, folder in patched.items()},
            **{f"{name}-reconfigure": fingerprint([*(folders[one] for one in local[name]), *patched.values()])
               for name in made},
            "ffmpeg-reconfigure": fingerprint([], *ffmpeg),
            "busybox-reconfigure": fingerprint([TOP / name for name in BUSYBOX]),
            "linux-reconfigure": fingerprint(_kernel_files(config))}


def fresh_target(build: pathlib.Path) -> None:
    """Let all packages be installed again into an empty folder, without compiling."""
    shutil.rmtree(build / "target", ignore_errors=True)
    for name in ("decode", "store"):  # meson does not replace a program of an earlier build by a link
        (build / "staging/usr/bin" / name).unlink(missing_ok=True)
    stamps = [*build.glob("build/*/.stamp_target_installed"),
              *build.glob("build/host-gcc-final-*/.stamp_host_installed")]  # it brings the libraries
    for stamp in stamps:
        stamp.unlink()
        (stamp.parent / ".stamp_installed").unlink(missing_ok=True)


def begin(build: pathlib.Path, wanted: dict[str, str]) -> list[str]:
    """Compare the folder's hashes with the wanted ones: the targets to make first. Changed parts count as unknown until
    end(), so that an interrupted build is not trusted."""
    path = build / ".made-of"
    if not (build / "build").exists():
        path.write_text(json.dumps(wanted))
        return []
    known = json.loads(path.read_text()) if path.exists() else {}
    changed = [name for name in wanted if known.get(name) != wanted[name]]
    path.write_text(json.dumps({name: "" if name in changed else key for name, key in wanted.items()}))
    if CLEAN in changed:
        return [CLEAN]
    if TARGET in changed:
        fresh_target(build)
    return [name for name in changed if name != TARGET]


def end(build: pathlib.Path, made: dict[str, str]) -> None:
    """Record a finished build."""
    (build / ".made-of").write_text(json.dumps(made))
