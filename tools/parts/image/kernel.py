# SPDX-License-Identifier: GPL-2.0-or-later
"""The development image's kernel: Debian's 6.12 from backports, the modules of board/dev/modules.txt, an initramfs."""
import fnmatch
import lzma
import pathlib
import shutil

from parts.common import OUTPUT, TOP, entries, fingerprint, run, step
from parts.image import foreign
from parts.image.archive import Archive

PACKAGE = r"linux-image-6\.12\.[0-9.]*\+deb12[0-9.]*-amd64"
LIST = TOP / "board/dev/modules.txt"
INIT = TOP / "board/dev/init"
APPLETS = """sh mount umount modprobe switch_root cat readlink basename dirname hexdump find sort xargs sleep
reboot""".split()  # what INIT uses


def themes() -> dict[str, list[str]]:
    return {theme: words.split() for theme, words in (line.split(":", 1) for line in entries(LIST))}


def _needed(names: list[str], tree: pathlib.Path) -> list[str]:
    """Paths of modules and of all that they depend on, below lib/modules/<release>."""
    depends: dict[str, list[str]] = {}
    paths: dict[str, str] = {}
    for line in (tree / "modules.dep").read_text().splitlines():
        path, needs = line.split(":", 1)
        depends[path] = needs.split()
        paths[pathlib.Path(path).name.split(".")[0].replace("-", "_")] = path
    soft = [line.split() for line in (tree / "modules.softdep").read_text().splitlines()
            if line.startswith("softdep")]
    builtin = {pathlib.Path(line).stem.replace("-", "_")
               for line in (tree / "modules.builtin").read_text().splitlines()}
    wanted: dict[str, None] = {}

    def add(name: str) -> None:
        name = name.replace("-", "_")
        if name in paths and paths[name] not in wanted:
            wanted[paths[name]] = None
            for path in depends[paths[name]]:
                add(pathlib.Path(path).name.split(".")[0])
            for words in soft:
                if fnmatch.fnmatch(name, words[1].replace("-", "_")):
                    for word in words[2:]:
                        if not word.endswith(":"):
                            add(word)

    for name in names:
        if name.replace("-", "_") not in paths and name.replace("-", "_") not in builtin:
            raise KeyError(f"the kernel has no module {name}")
        add(name)
    return list(wanted)


def _copy_modules(source: pathlib.Path, names: list[str], target: pathlib.Path) -> None:
    """Copy modules, unpacked (the file system compresses better), and index them. Their signatures and their types
    (BTF) are left out: the kernel would check both, which takes a tenth of an emulated boot. The products' kernels have
    neither."""
    release, copied = source.name, list[pathlib.Path]()
    for path in _needed(names, source):
        place = target / "lib/modules" / release / path.removesuffix(".xz")
        place.parent.mkdir(parents=True, exist_ok=True)
        data = (source / path).read_bytes()
        place.write_bytes(lzma.decompress(data) if path.endswith(".xz") else data)
        copied.append(place)
    run(["strip", "--strip-debug", "--remove-section=.BTF", *copied])
    for name in ["modules.builtin", "modules.builtin.modinfo", "modules.order"]:
        shutil.copy(source / name, target / "lib/modules" / release)
    run(["depmod", "-b", target, release])
    for binary in (target / "lib/modules" / release).glob("modules.*.bin"):
        binary.unlink()  # BusyBox reads the text files


def package() -> str:
    """The name of Debian's package."""
    return foreign.asked("kernel.name", lambda: Archive().newest(PACKAGE))


def kernel() -> pathlib.Path:
    """Output folder with boot/vmlinuz, boot/config, lib/modules."""
    out = OUTPUT / "dev/kernel"
    archive = Archive()
    name = package()

    def unpack(tree: pathlib.Path) -> None:
        run(["dpkg-deb", "-x", archive.package(name), tree])
        run(["depmod", "-b", tree, next((tree / "lib/modules").iterdir()).name])

    unpacked = foreign.kept("kernel", fingerprint([], name), unpack)

    def modules() -> None:
        shutil.rmtree(out, ignore_errors=True)
        (out / "boot").mkdir(parents=True)
        shutil.copy(next((unpacked / "boot").glob("vmlinuz-*")), out / "boot/vmlinuz")
        shutil.copy(next((unpacked / "boot").glob("config-*")), out / "boot/config")
        source = next((unpacked / "lib/modules").iterdir())
        _copy_modules(source, [name for words in themes().values() for name in words], out)
        _copy_modules(source, themes()["boot"] + themes()["mount"], out / "initramfs")

    step("kernel: modules", OUTPUT / "dev/kernel.stamp", fingerprint([LIST, pathlib.Path(__file__)], name), modules)
    return out


def initramfs(kernel_folder: pathlib.Path, busybox: pathlib.Path, libraries: list[pathlib.Path],
              to: pathlib.Path) -> None:
    """BusyBox, its libraries, the boot modules and board/dev/init, packed."""
    tree = kernel_folder.parent / "initramfs"
    shutil.rmtree(tree, ignore_errors=True)
    for folder in ["bin", "dev", "proc", "root", "sys"]:
        (tree / folder).mkdir(parents=True)
    shutil.copytree(kernel_folder / "initramfs/lib", tree / "lib", symlinks=True)
    shutil.copy(busybox, tree / "bin/busybox")
    for applet in APPLETS:
        (tree / "bin" / applet).symlink_to("busybox")
    for library in libraries:
        place = tree / library.relative_to("/")
        place.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(library, place)
    shutil.copy(INIT, tree / "init")
    pack = 'find . | LC_ALL=C sort | cpio --quiet -o -H newc -R 0:0 | gzip -6 > "$1"'
    run(["sh", "-c", pack, "sh", to.resolve()], cwd=tree)
