# SPDX-License-Identifier: GPL-2.0-or-later
"""The image contains exactly what board/common/manifest.txt lists."""
import pathlib
import re

import pytest

from lib import manifest
from parts.common import TOP, entries, run
from parts.guest import machine

from .conftest import BOARD

pytestmark = pytest.mark.retry

# Kinds of lines, and the word that is falsified. Ports are scanned from outside in test_ssh.py and test_ports.py.
SPOILT = {"applet": 1, "program": 1, "kernel": 1, "module": 1, "group": 2, "user": 2, "service": 1, "disk": 2,
          "partition": 3}
ELSEWHERE = {"port"}
# Loaded by glibc itself, or kept by it for old programs
GLIBC_S_OWN = {"ld-linux", "libanl", "libdl", "libgcc_s", "libnss_dns", "libnss_files", "libpthread", "librt",
               "libutil"}
DATA = 128 << 10   # bytes of a program's initialized data
BLOCK = 128 << 10  # bytes of the squashfs


def services(root: pathlib.Path) -> list[str]:
    wanted, found = manifest.services(root)
    return [] if found == wanted else [f"services: {found}"]


def complaints(root: pathlib.Path, image: pathlib.Path) -> dict[str, list[str]]:
    """Differences from the manifest, by kind of line."""
    accounts = manifest.accounts(root)
    disk = manifest.disk(image)
    return {"applet": manifest.applets(root), "program": manifest.programs(root),
            "kernel": manifest.kernel(image.parent / "kernel/boot/config"), "module": manifest.modules(root),
            "group": accounts, "user": accounts, "service": services(root), "disk": disk, "partition": disk}


def test_applets(root: pathlib.Path) -> None:
    assert manifest.applets(root) == []


def test_programs(root: pathlib.Path) -> None:
    assert manifest.programs(root) == []


def test_kernel_options(image: pathlib.Path) -> None:
    assert manifest.kernel(image.parent / "kernel/boot/config") == []


def test_modules(root: pathlib.Path) -> None:
    assert manifest.modules(root) == []


def test_users_and_groups(root: pathlib.Path) -> None:
    assert manifest.accounts(root) == []


def test_services_and_their_order(root: pathlib.Path) -> None:
    assert services(root) == []


def test_disk_layout(image: pathlib.Path) -> None:
    assert manifest.disk(image) == []


def test_the_image_fits_a_card_of_1_gb(image: pathlib.Path) -> None:
    """As docs/technician.md promises; a card may be some percent smaller than its label."""
    assert "a card of 1 GB" in (TOP / "docs/technician.md").read_text()
    assert image.stat().st_size < 900e6


def test_each_kind_of_line_has_a_falsified_case() -> None:
    assert {line.split()[0] for line in manifest.lines()} == SPOILT.keys() | ELSEWHERE


@pytest.mark.parametrize("kind", SPOILT)
def test_a_falsified_line_is_found(root: pathlib.Path, image: pathlib.Path, monkeypatch: pytest.MonkeyPatch,
                               kind: str) -> None:
    """Proves that the check can fail: the last line of each kind is falsified."""
    lines = manifest.lines()
    last = max(number for number, line in enumerate(lines) if line.split()[0] == kind)
    words = lines[last].split()
    words[SPOILT[kind]] += "9"
    lines[last] = " ".join(words)
    monkeypatch.setattr(manifest, "lines", lambda: lines)
    assert complaints(root, image)[kind] != []


@pytest.mark.parametrize("library, programs", [("libx264", {"ddxvideosave", "ddxvideosend"}),
                                               ("libdrm", {"ddxvideoplay", "ddxvideoview"})])
def test_a_library_is_loaded_by_the_programs_that_call_it_alone(root: pathlib.Path, library: str,
                                                                programs: set[str]) -> None:
    """Linked to one of FFmpeg's, it would cost each grabber memory and time at its start; x264, the licence as well."""
    name = library.encode() + b".so"
    linked = {path.name for path in root.rglob("*") if path.is_file() and not path.is_symlink() and
              path.stat().st_mode & 0o111 and name in path.read_bytes() and library not in path.name}
    assert linked == programs


def test_each_library_is_needed_by_a_program(root: pathlib.Path) -> None:
    """Packages bring more: board/common/post-build.sh removes them."""
    files = {path: path.read_bytes() for path in root.rglob("*") if path.is_file() and not path.is_symlink()
             and path.open("rb").read(4) == b"\x7fELF"}
    libraries = {path: path.name.split(".so")[0].encode() + b".so" for path in files
                 if ".so." in path.name and path.parent.name == "lib"}
    unneeded = {path.name.split(".so")[0] for path, name in libraries.items()
                if not any(name in text for other, text in files.items() if other != path)}
    assert libraries and unneeded <= GLIBC_S_OWN


def test_no_program_brings_a_large_struct_in_its_file(root: pathlib.Path) -> None:
    """Structs without initial values take no bytes of the image, and no memory before they are used."""
    programs = [path for folder in ("usr/bin", "usr/sbin", "usr/libexec/ddx") for path in (root / folder).iterdir()
                if path.is_file() and not path.is_symlink() and path.open("rb").read(4) == b"\x7fELF"]
    assert programs
    lines = [line.split() for line in run(["size", *programs]).splitlines()[1:]]
    assert [words[-1] for words in lines if int(words[1]) > DATA] == []


def test_files_that_each_boot_reads_lie_unpacked(image: pathlib.Path, root: pathlib.Path) -> None:
    """The first block of each, as it is, is in the squashfs. A product's modules lie there unpacked, too."""
    packed = (image.parent / "rootfs.squashfs").read_bytes()
    lines = [*entries(TOP / "board/common/boot-files.txt"), *([] if BOARD == machine.DEV else ["*.ko"])]
    listed = {path for line in lines for path in (root.glob(line[1:]) if line.startswith("/") else root.rglob(line))
              if path.is_file() and not path.is_symlink()}
    assert len(listed) > 50
    blocks = {path: path.open("rb").read(BLOCK) for path in listed}
    assert [str(path) for path, block in blocks.items() if block not in packed] == []


@pytest.mark.skipif(BOARD == machine.DEV, reason="the development image's FFmpeg is built for this machine")
def test_ffmpeg_detects_processor_features_at_run_time(root: pathlib.Path) -> None:
    """Code for newer processors is built in; `configure` takes the last word of each pair."""
    library = next(path for path in (root / "usr/lib").glob("libavutil.so.*") if not path.is_symlink())
    words = re.search(rb"--prefix=[^\0]*", library.read_bytes())
    assert words
    said = {name: what for what, name in re.findall(r"--(enable|disable)-(x86asm|mmx|sse\w*|ssse3|avx2?)(?= |$)",
                                                    words[0].decode())}
    assert {"x86asm", "sse2", "ssse3", "avx2"} <= said.keys()
    assert {name for name, what in said.items() if what == "disable"} == set()
