# SPDX-License-Identifier: GPL-2.0-or-later
"""The product's Buildroot tree, checked without a build."""
import hashlib
import os
import pathlib
import re
import shutil
import subprocess

import buildroot
import pytest
from parts import trees
from parts.common import OUTPUT, TOP, run
from parts.guest import machine
from parts.image import buildroot_fragments, cyclonedds, native

pytestmark = [pytest.mark.retry, pytest.mark.computes]

PYTHON = "/usr/bin/python3"
OURS = sorted(name for name, path in trees.defconfigs().items() if path.is_relative_to(trees.BUILDROOT))


def test_every_board_has_all_its_files() -> None:
    assert len(buildroot.boards()) >= 2
    for board in buildroot.boards():
        assert {"title", "qemu", "cpu", "firmware"} <= set(machine.meta(board))
        assert (trees.boards()[board] / "kernel.fragment").is_file()


def test_defconfigs_differ_only_in_the_machine() -> None:
    """The long lists of the defconfigs stay equal."""
    machine = ("BR2_x86_", "BR2_i386", "BR2_TIME_BITS_64", "BR2_TARGET_GRUB2_X86_64_EFI",
               "BR2_LINUX_KERNEL_NEEDS_HOST_LIBELF")
    texts = {board: [line.replace(f"board/{board}/", "board/BOARD/") for line in
                     (TOP / f"configs/ddxvideo_{board}_defconfig").read_text().splitlines()[1:]
                     if line and not line.startswith(machine)] for board in OURS}
    first = next(iter(texts.values()))
    for board, lines in texts.items():
        assert lines == first, board


def test_every_fragment_is_used_and_every_option_set_once() -> None:
    themes = sorted((TOP / "board/common/kernel").glob("*.fragment"))
    text = (TOP / "configs/ddxvideo_miniitx_defconfig").read_text()
    seen: dict[str, pathlib.Path] = {}
    for path in themes:
        assert f"board/common/kernel/{path.name}" in text
        for name in buildroot_fragments.options(path):
            assert name not in seen, f"{name} is in {path.name} and in {seen[name].name}"
            seen[name] = path


@pytest.mark.parametrize("board", OURS)
def test_the_kernel_s_source_is_verified(board: str) -> None:
    """Buildroot has no hash for a kernel version given by number, and would only warn."""
    text = (TOP / f"configs/ddxvideo_{board}_defconfig").read_text()
    version = re.search(r'^BR2_LINUX_KERNEL_CUSTOM_VERSION_VALUE="(.*)"$', text, re.M)
    assert version and "BR2_DOWNLOAD_FORCE_CHECK_HASHES=y" in text
    assert 'BR2_GLOBAL_PATCH_DIR="$(BR2_EXTERNAL_DDXVIDEO_PATH)/../board/common/patches"' in text
    for package in ("linux", "linux-headers"):
        hashes = (TOP / f"board/common/patches/{package}/{package}.hash").read_text()
        for name in (f"linux-{version[1]}.tar.xz", "COPYING", "LICENSES/preferred/GPL-2.0",
                     "LICENSES/exceptions/Linux-syscall-note"):
            assert re.search(rf"^sha256  [0-9a-f]{{64}}  {re.escape(name)}$", hashes, re.M)


def test_the_licences_of_our_packages_are_verified() -> None:
    """Otherwise legal-info warns "no hash file" for each, which hides relevant warnings."""
    packages = [path for path in TOP.glob("package/*/*.mk") if "_SITE_METHOD = local" in path.read_text()]
    assert packages
    for package in packages:
        files = re.findall(r"LICENSE_FILES = (.*)", package.read_text())[0].split()
        assert "_POST_RSYNC_HOOKS += DDXVIDEO_COPY_LICENSES\n" in package.read_text(), package
        texts = [(TOP if name.startswith("LICENSES/") else package.parent) / name for name in files]
        expected = [f"sha256  {hashlib.sha256(text.read_bytes()).hexdigest()}  {name}"
                    for text, name in zip(texts, files)]
        assert package.with_suffix(".hash").read_text().splitlines()[1:] == expected, package


@pytest.mark.skipif(not buildroot.present(), reason="no Buildroot here")
def test_a_changed_kernel_source_is_refused(tmp_path: pathlib.Path) -> None:
    """Uses Buildroot's check, with the hash files that Buildroot names for the two packages."""
    env = {**os.environ, "BUILDROOT_OUTPUT": str(tmp_path / "out")}
    variables = ["LINUX_HASH_FILES", "LINUX_HEADERS_HASH_FILES"]
    found = subprocess.run([PYTHON, "-B", TOP / "tools/buildroot.py", "make", "miniitx", "-s", "printvars",
                            f"VARS={' '.join(variables)}"], env=env, check=True, capture_output=True, text=True).stdout
    files = {name: value.split() for line in found.splitlines() for name, _, value in [line.partition("=")]
             if name in variables}
    wrong = tmp_path / "linux-6.12.91.tar.xz"
    wrong.write_text("another one")
    for variable in variables:
        done = subprocess.run([buildroot.checkout() / "support/download/check-hash", wrong, wrong.name,
                               *files[variable]], check=False, capture_output=True, text=True)
        assert (done.returncode, "has wrong sha256" in done.stderr) == (2, True), variable


@pytest.mark.parametrize("wanted, have, good", [
    ("CONFIG_A=y", "CONFIG_A=y", True), ("CONFIG_A=m", "CONFIG_A=y", True), ("CONFIG_A=y", "CONFIG_A=m", False),
    ("CONFIG_A=m", "# CONFIG_A is not set", False), ("CONFIG_A=m", "", False), ("# CONFIG_A is not set", "", True),
    ("# CONFIG_A is not set", "CONFIG_A=y", False), ('CONFIG_A="x"', 'CONFIG_A="y"', False)])
def test_a_dropped_option_is_found(tmp_path: pathlib.Path, wanted: str, have: str, good: bool) -> None:
    (tmp_path / "fragment").write_text(f"# comment\n{wanted}\n")
    (tmp_path / "config").write_text(f"{have}\n")
    done = subprocess.run([PYTHON, "-B", "-m", "parts.image.buildroot_fragments", tmp_path / "config",
                           tmp_path / "fragment"], cwd=TOP / "tools", capture_output=True, text=True, check=False)
    assert (done.returncode == 0) == good
    assert ("CONFIG_A" in done.stderr) == (not good)


def test_a_third_board_needs_only_data(tmp_path: pathlib.Path) -> None:
    for folder in ["board", "buildroot-external", "tools"]:
        shutil.copytree(TOP / folder, tmp_path / folder)
    shutil.copytree(TOP / "board/pc104", tmp_path / "board/third")
    configs = tmp_path / "buildroot-external/configs"
    text = (configs / "ddxvideo_pc104_defconfig").read_text()
    (configs / "ddxvideo_third_defconfig").write_text(text.replace("board/pc104/", "board/third/"))
    done = subprocess.run([PYTHON, "-B", tmp_path / "tools/buildroot.py", "boards"], capture_output=True, text=True,
                          check=True)
    assert "third" in [line.split()[0] for line in done.stdout.splitlines()]
    if os.environ.get("BUILDROOT"):
        shutil.copytree(TOP / "package", tmp_path / "package")
        env = {**os.environ, "BUILDROOT_OUTPUT": str(tmp_path / "out")}
        subprocess.run([PYTHON, "-B", tmp_path / "tools/buildroot.py", "make", "third", "-s", "printvars",
                        "VARS=LINUX_KCONFIG_FRAGMENT_FILES"], env=env, check=True, capture_output=True)


def ffmpeg_parts(text: str, pattern: str) -> dict[str, set[str]]:
    """The wanted parts by kind: encoder, decoder ..."""
    found: dict[str, set[str]] = {}
    for kind, names in re.findall(pattern, text):
        found.setdefault(kind.lower(), set()).update(re.split("[, ]", names))
    return found


@pytest.mark.parametrize("board", OURS)
def test_both_kinds_of_image_have_the_same_ffmpeg_parts(board: str) -> None:
    development = ffmpeg_parts((TOP / "board/common/ffmpeg.config").read_text(), r"--enable-(\w+)=(\S+)")
    text = (TOP / f"buildroot-external/configs/ddxvideo_{board}_defconfig").read_text()
    assert ffmpeg_parts(text, r'FFMPEG_(\w+)S="([^"-]+)"') == development
    assert set(development) == {"encoder", "decoder", "muxer", "protocol"}


def test_desk_programs_use_libsrtp_without_openssl() -> None:
    """As in the product. Without libsrtp2 the programs would be built without encryption."""
    root = native.build()
    assert "-DWITH_SRTP" in (OUTPUT / "desk/ddxvideo/compile_commands.json").read_text()
    libraries = run(["pkg-config", "--static", "--libs", "libsrtp2"], env=native.environment(root)).split()
    assert [word for word in libraries if word.startswith("-l")] == ["-lsrtp2"]


def test_desk_programs_contain_the_patched_libdc1394() -> None:
    """Linked statically; the system's library lacks the patch."""
    root = native.build()
    assert "/grab/iidc/iidc_camera.c" in (OUTPUT / "desk/ddxvideo/compile_commands.json").read_text()
    assert "dc1394" not in run(["ldd", root / "usr/bin/ddxvideo1394"], env=native.environment(root))
    symbols = run(["nm", root / native.LIBRARIES / "libdc1394.a"])
    assert "U libusb_cancel_transfer" in symbols and "raw1394" not in symbols


def test_desk_and_product_have_the_same_cyclonedds() -> None:
    """Linked statically into the catalog, without the parts that need OpenSSL or C++."""
    root = native.build()
    assert {"-DENABLE_SSL=OFF", "-DENABLE_SECURITY=OFF"} < set(cyclonedds.options())
    libraries = run(["ldd", root / "usr/bin/ddxcatalog"], env=native.environment(root))
    assert [word for word in ("ddsc", "ssl", "crypto", "stdc++") if word in libraries] == []
    assert "11.0.1" in (root / native.LIBRARIES / "pkgconfig/CycloneDDS.pc").read_text()


def test_the_comparison_of_builds_names_each_difference(tmp_path: pathlib.Path) -> None:
    for name, text in [("first", "one"), ("second", "two")]:
        (tmp_path / name / "usr/bin").mkdir(parents=True)
        (tmp_path / name / "usr/bin/same").write_text("same")
        (tmp_path / name / "usr/bin/program").write_text(text)
        (tmp_path / name / "link").symlink_to(text)
    (tmp_path / "second/more").touch()
    assert not buildroot.differences(tmp_path / "first", tmp_path / "first")
    found = "\n".join(buildroot.differences(tmp_path / "first", tmp_path / "second"))
    assert [name for name in ("program", "link", "more", "same") if name in found] == ["program", "link", "more"]
