# SPDX-License-Identifier: GPL-2.0-or-later
"""What has to be made again of what an earlier build left in Buildroot's folder: derived from what that was made of.

Buildroot itself looks at none of it. What it cannot build again piece by piece (toolchain, options of packages) costs
a build from nothing; and the target folder is filled again, so that nothing stays in it that the tree no longer has.
"""
import json
import pathlib
import re
import shutil

from parts import trees
from parts.common import TOP, fingerprint

CLEAN, TARGET = "clean", "target"
# Options that name files of ours (those are looked at), or steps that are repeated in each build.
NAMES_FILES = re.compile(r"BR2_(ROOTFS_(OVERLAY|POST_\w+_SCRIPT|DEVICE_TABLE)|GLOBAL_PATCH_DIR|PACKAGE_BUSYBOX_CONFIG|"
                         r"LINUX_KERNEL_(CUSTOM_CONFIG_FILE|CONFIG_FRAGMENT_FILES)|DL_DIR|JLEVEL|DEFCONFIG)=")
KERNEL = re.compile(r'^BR2_LINUX_KERNEL_(?:CUSTOM_CONFIG_FILE|CONFIG_FRAGMENT_FILES)="(.*)"$', re.M)
FFMPEG = "BR2_PACKAGE_FFMPEG_"
BUSYBOX = ["board/common/busybox.config", "board/common/manifest.txt", "tools/buildroot_busybox.py",
           "tools/parts/image/busybox.py"]


def _kernel_files(config: str) -> list[pathlib.Path]:
    text = " ".join(KERNEL.findall(config))
    for name, tree in trees.buildroot().items():
        text = text.replace(f"$(BR2_EXTERNAL_{name}_PATH)", str(tree))
    return [pathlib.Path(name).resolve() for name in text.split()]


def keys(config: str, commit: str, sources: str) -> dict[str, str]:
    """A hash for each target of Buildroot's (CLEAN among them), and for the target folder. `config`: Buildroot's
    .config, `commit`: Buildroot's, `sources`: of all of ours that goes into the image."""
    options = [line for line in config.splitlines() if line.startswith("BR2_") and not NAMES_FILES.match(line)]
    ffmpeg = [line for line in options if line.startswith(FFMPEG)]
    folders, foreign, local = trees.packages(), trees.foreign(), trees.local_packages()
    other = [folder for name, folder in folders.items() if name not in local]
    # The appliance has all of ours; a package of another tree may be left out of the board's configuration.
    made = [name for name in local
            if name not in foreign or f"BR2_PACKAGE_{name.upper().replace('-', '_')}=y" in options]
    makefiles = [tree / "external.mk" for tree in trees.buildroot().values()]
    patches = [path for folder in trees.each("board/common/patches") for path in sorted(folder.rglob("*.patch"))]
    whole = [*makefiles, *other, *patches]
    return {CLEAN: fingerprint(whole, commit, *(line for line in options if line not in ffmpeg)),
            TARGET: fingerprint([], commit, sources, *options),
            **{f"{name}-reconfigure": fingerprint([folders[one] for one in local[name]]) for name in made},
            "ffmpeg-reconfigure": fingerprint([], *ffmpeg),
            "busybox-reconfigure": fingerprint([TOP / name for name in BUSYBOX]),
            "linux-reconfigure": fingerprint(_kernel_files(config))}


def fresh_target(build: pathlib.Path) -> None:
    """Every package is installed once more, into an empty folder; nothing is compiled for that."""
    shutil.rmtree(build / "target", ignore_errors=True)
    stamps = [*build.glob("build/*/.stamp_target_installed"),
              *build.glob("build/host-gcc-final-*/.stamp_host_installed")]  # it brings the libraries
    for stamp in stamps:
        stamp.unlink()
        (stamp.parent / ".stamp_installed").unlink(missing_ok=True)


def begin(build: pathlib.Path, wanted: dict[str, str]) -> list[str]:
    """The targets to make before all others, after a look at what the folder was made of. What is about to change
    counts as unknown until end(), so a build that is broken off is not believed."""
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
    """All is as wanted."""
    (build / ".made-of").write_text(json.dumps(made))
