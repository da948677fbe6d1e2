# SPDX-License-Identifier: GPL-2.0-or-later
"""What has to be made again of what an earlier build left in Buildroot's folder: derived from what that was made of.

Buildroot itself looks at none of it. What it cannot build again piece by piece (toolchain, options of packages) costs
a build from nothing; and the target folder is filled anew, so that nothing stays in it that the tree no longer has.
"""
import json
import pathlib
import re
import shutil

from parts.common import TOP, fingerprint

EXTERNAL = TOP / "buildroot-external"
CLEAN, TARGET = "clean", "target"
# Options that name files of ours (those are looked at), or what is done anew in each build.
NAMES_FILES = re.compile(r"BR2_(ROOTFS_(OVERLAY|POST_\w+_SCRIPT|DEVICE_TABLE)|GLOBAL_PATCH_DIR|PACKAGE_BUSYBOX_CONFIG|"
                         r"LINUX_KERNEL_(CUSTOM_CONFIG_FILE|CONFIG_FRAGMENT_FILES)|DL_DIR|JLEVEL|DEFCONFIG)=")
KERNEL = re.compile(r'^BR2_LINUX_KERNEL_(?:CUSTOM_CONFIG_FILE|CONFIG_FRAGMENT_FILES)="(.*)"$', re.M)
FFMPEG = "BR2_PACKAGE_FFMPEG_"
BUSYBOX = ["board/common/busybox.config", "board/common/manifest.txt", "tools/buildroot_busybox.py",
           "tools/parts/image/busybox.py"]


def local_packages(folder: pathlib.Path = TOP / "package") -> dict[str, list[str]]:
    """Those whose source is in our tree, and which of them each is made of, itself included."""
    texts = {path.parent.name: path.read_text() for path in sorted(folder.glob("*/*.mk"))}
    local = {name: text for name, text in texts.items() if "_SITE_METHOD = local" in text}
    needs = {name: set(" ".join(re.findall(r"_DEPENDENCIES \+?= (.*)", text)).split()) & set(local)
             for name, text in local.items()}
    result: dict[str, list[str]] = {}
    for name in local:
        whole, wanted = {name}, set(needs[name])
        while wanted - whole:
            whole |= wanted
            wanted = {one for other in whole for one in needs[other]}
        result[name] = sorted(whole)
    return result


def keys(config: str, commit: str, sources: str) -> dict[str, str]:
    """A hash for each target of Buildroot's (CLEAN among them), and for the target folder. `config`: Buildroot's
    .config, `commit`: Buildroot's, `sources`: of all of ours that goes into the image."""
    options = [line for line in config.splitlines() if line.startswith("BR2_") and not NAMES_FILES.match(line)]
    ffmpeg = [line for line in options if line.startswith(FFMPEG)]
    local = local_packages()
    foreign = [path for path in sorted((TOP / "package").iterdir()) if path.is_dir() and path.name not in local]
    whole = [EXTERNAL / "external.mk", *foreign, *sorted((TOP / "board/common/patches").rglob("*.patch"))]
    kernel = " ".join(KERNEL.findall(config)).replace("$(BR2_EXTERNAL_DDXVIDEO_PATH)", str(EXTERNAL)).split()
    return {CLEAN: fingerprint(whole, commit, *(line for line in options if line not in ffmpeg)),
            TARGET: fingerprint([], commit, sources, *options),
            **{f"{name}-reconfigure": fingerprint([TOP / "package" / one for one in needs])
               for name, needs in local.items()},
            "ffmpeg-reconfigure": fingerprint([], *ffmpeg),
            "busybox-reconfigure": fingerprint([TOP / name for name in BUSYBOX]),
            "linux-reconfigure": fingerprint([pathlib.Path(name).resolve() for name in kernel])}


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
