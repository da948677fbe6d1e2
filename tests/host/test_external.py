# SPDX-License-Identifier: GPL-2.0-or-later
"""EXTERNAL=path[:path]: a package, a board and an overlay of another tree are built like ours."""
from __future__ import annotations

import os
import pathlib
import shutil
import subprocess
import sys

import buildroot
import pytest

from lib import manifest
from parts import trees
from parts.common import OUTPUT, TOP, BadInput
from parts.guest import machine
from parts.image import busybox, ffmpeg, native, rootfs, tables
from parts.release import renew

pytestmark = pytest.mark.retry

FILES = {
    "external.desc": "name: MINE\ndesc: a robot\n",
    "external.mk": "include $(sort $(wildcard $(BR2_EXTERNAL_MINE_PATH)/package/*/*.mk))\n",
    "Config.in": 'source "$BR2_EXTERNAL_MINE_PATH/package/blink/Config.in"\n',
    "package/blink/Config.in": 'config BR2_PACKAGE_BLINK\n\tbool "blink"\n\tdefault y\n\tselect BR2_PACKAGE_DDX\n',
    "package/blink/blink.mk": "BLINK_SITE_METHOD = local\nBLINK_SITE = $(BR2_EXTERNAL_MINE_PATH)/package/blink\n"
                              "BLINK_DEPENDENCIES = ddx\nBLINK_USERS = $(call ddx-users,blink)\n"
                              "$(eval $(meson-package))\n",
    "package/blink/programs.txt": ". S70blink blink 950 lights a lamp\n",
    "package/blink/meson.build": """project('blink', 'c')
executable('blink', 'blink.c', dependencies: [dependency('ddx-program'), dependency('ddx')], install: true)
install_data('S70blink', install_dir: get_option('sysconfdir') / 'init.d', install_mode: 'rwxr-xr-x')
install_data('blink.default', rename: 'blink', install_dir: get_option('sysconfdir') / 'default')
""",
    "package/blink/blink.c": """#include <program.h>
int main(int argc, char **argv) {
    struct program program = {.name = "blink", .purpose = "Lights a lamp."};
    program_start(&program, argc, argv);
    return EXIT_OK;
}
""",
    "package/blink/S70blink": "#!/bin/sh\n",
    "package/blink/blink.default": "enabled=no\nuser=blink\n",
    "overlay/etc/lamp.conf": "pin=4\n",
    "overlay/etc/default/ddxhealth": "user=ddxhealth\nsilence=7\n",
    "overlay/bin/vi": "#!/bin/sh\n",  # a link to BusyBox in ours
    "board/lamp/meta": "title=a lamp\nqemu=qemu-system-x86_64\ncpu=qemu64\nmachine=pc\nmemory=256\nfirmware=bios\n",
    "board/lamp/kernel.fragment": "CONFIG_LEDS=y\n",
    "board/common/manifest.txt": "program /usr/bin/blink\n",
    "configs/ddxvideo_lamp_defconfig": "BR2_x86_64=y\n",
}


def make_tree(top: pathlib.Path) -> pathlib.Path:
    for name, text in FILES.items():
        (top / name).parent.mkdir(parents=True, exist_ok=True)
        (top / name).write_text(text)
    return top


@pytest.fixture(name="mine")
def _mine(tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> pathlib.Path:
    monkeypatch.setenv("EXTERNAL", str(tmp_path / "mine"))
    return make_tree(tmp_path / "mine")


@pytest.fixture(name="desk")
def _desk(tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> pathlib.Path:
    """A copy of the desk's build, since other tests run its programs. It is faster without the large packages."""
    shutil.copytree(OUTPUT / "desk/root", tmp_path / "desk/root", symlinks=True, ignore=shutil.ignore_patterns("*bin"))
    monkeypatch.setattr(native, "OUTPUT", tmp_path)
    return tmp_path / "desk/root"


def test_an_image_has_program_user_script_settings_and_overlay(mine: pathlib.Path, desk: pathlib.Path,
                                                               tmp_path: pathlib.Path) -> None:
    assert native.packages()[-1] == "blink"
    native.build(chosen=["blink"])
    (tmp_path / "kernel/lib").mkdir(parents=True)
    root = tmp_path / "root"
    rootfs.assemble(root, busybox.busybox(), tmp_path / "kernel", [desk, ffmpeg.ffmpeg()])
    assert (root / "usr/bin/blink").read_bytes().startswith(b"\x7fELF")
    assert "blink:x:950:900:lights a lamp:" in (root / "etc/passwd").read_text()
    assert os.access(root / "etc/init.d/S70blink", os.X_OK)
    assert "user=blink\n" in (root / "etc/default/blink").read_text()
    assert (root / "etc/lamp.conf").read_text() == "pin=4\n"
    assert "argument=-silence\nargument=7\n" in (
        root / "usr/share/ddx/ready/ddxhealth/service/ddxhealth/launch").read_text()
    assert "blink" not in (root / "usr/share/ddx/ready/idle").read_text()  # its script is its own
    assert (root / "bin/vi").read_text() == "#!/bin/sh\n"
    assert (root / "bin/busybox").read_bytes().startswith(b"\x7fELF")
    assert not manifest.accounts(root)
    assert ["/usr/bin/blink"] in manifest.wanted("program") and "/usr/bin/blink" not in manifest.programs(root)
    wanted, found = manifest.services(root)
    assert wanted == found and "S70blink" in found


def test_a_tree_that_is_no_longer_named_leaves_no_files(mine: pathlib.Path, desk: pathlib.Path,
                                                         monkeypatch: pytest.MonkeyPatch) -> None:
    native.build(chosen=["blink"])
    assert (desk / "usr/bin/blink").exists()
    monkeypatch.delenv("EXTERNAL")
    native.build(chosen=[])
    assert not (desk / "usr/bin/blink").exists() and not (desk.parent / "blink").exists()
    assert not list(desk.glob(".ddx*"))  # no stamps either, so that the next build installs ours again


def test_buildroot_has_both_trees(mine: pathlib.Path, tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Checks its arguments; a makefile replaces Buildroot."""
    (tmp_path / "stub").mkdir()
    (tmp_path / "stub/Makefile").write_text("%_defconfig:\n\techo '$@ $(BR2_EXTERNAL)' > $(O)/.config\n")
    monkeypatch.setattr(buildroot, "checkout", lambda: tmp_path / "stub")
    monkeypatch.setenv("BUILDROOT_OUTPUT", str(tmp_path / "out"))
    assert {"miniitx", "pc104", "lamp"} <= set(buildroot.boards())
    command, _ = buildroot.configured("lamp")
    assert f"BR2_EXTERNAL={TOP}/buildroot-external:{mine}" in command
    assert (tmp_path / "out/.config").read_text() == f"ddxvideo_lamp_defconfig {TOP}/buildroot-external:{mine}\n"
    (mine / "package/blink/Config.in").write_text(FILES["package/blink/Config.in"].replace("y\n", "n\n"))
    (tmp_path / "out/.config").write_text("by hand\n")
    buildroot.configured("lamp")  # there are other trees to choose from
    assert "by hand" not in (tmp_path / "out/.config").read_text()


@pytest.mark.long
@pytest.mark.skipif(not buildroot.present(), reason="no Buildroot here")
def test_buildroot_makes_the_user_and_takes_the_overlay(mine: pathlib.Path, tmp_path: pathlib.Path) -> None:
    done = subprocess.run(
        [sys.executable, "-B", TOP / "tools/buildroot.py", "make", "pc104", "-s", "printvars",
         "VARS=BLINK_USERS BR2_ROOTFS_OVERLAY"],
        env={**os.environ, "BUILDROOT_OUTPUT": str(tmp_path / "out")}, check=True, capture_output=True, text=True)
    assert "BLINK_USERS=blink 950 ddx 900 * - /bin/false - lights a lamp\n" in done.stdout
    assert f"BR2_ROOTFS_OVERLAY={TOP}/buildroot-external/../overlay {mine}/overlay\n" in done.stdout
    assert "BR2_PACKAGE_BLINK=y\n" in (tmp_path / "out/.config").read_text()


def test_changes_in_another_tree_are_built(mine: pathlib.Path) -> None:
    config = 'BR2_LINUX_KERNEL_CONFIG_FRAGMENT_FILES="$(BR2_EXTERNAL_MINE_PATH)/board/lamp/kernel.fragment"\n'

    def keys() -> dict[str, str]:
        return renew.keys(config + "BR2_PACKAGE_BLINK=y\n", "1", machine.sources("lamp"))

    for name, concerned in [("package/blink/blink.c", "blink-reconfigure"), ("external.mk", renew.CLEAN),
                            ("board/lamp/kernel.fragment", "linux-reconfigure"), ("overlay/etc/lamp.conf", "target")]:
        before = keys()
        (mine / name).write_text(FILES[name] + "\n")
        after = keys()
        assert sorted(key for key in after if after[key] != before[key]) == sorted({concerned, "target"})
    assert "blink-reconfigure" not in renew.keys(config, "1", "2")  # a package that is not selected is not built


def spoil(mine: pathlib.Path, name: str, text: str) -> None:
    (mine / name).parent.mkdir(parents=True, exist_ok=True)
    (mine / name).write_text(text)


@pytest.mark.parametrize("name, text, words", [
    ("package/ddx/meson.build", "", r"mine/package/ddx has the name of .*/package/ddx; give it another one"),
    ("board/pc104/meta", "", r"mine/board/pc104 has the name of .*/board/pc104"),
    ("configs/ddxvideo_pc104_defconfig", "", r"ddxvideo_pc104_defconfig has the name of"),
    ("package/blink/programs.txt", ". S70blink blink 902 a lamp\n",
     r"mine/package/blink/programs.txt: the number 902 is in .*/ddxvideo/programs.txt already"),
    ("package/blink/programs.txt", ". S70blink ddxload 950 a lamp\n", "the user ddxload is in"),
    ("package/blink/programs.txt", ". S70ddxdecode blink 950 a lamp\n", "the service ddxdecode is in"),
    ("package/blink/programs.txt", ". S70blink blink\n",
     r"blink/programs.txt: '. S70blink blink': needed are folder, init script"),
    ("package/blink/programs.txt", ". S70blink blink 0 a lamp\n", "from 901 to 999"),
    ("package/blink/programs.txt", ". S70blink root 950 a lamp\n", "the user root is in /etc/passwd already"),
    ("package/blink/programs.txt", ". S70-rf blink 950 a lamp\n", "'. S70-rf blink 950 a lamp': needed are folder"),
    ("package/blink/programs.txt", ". S70blink blink 95\u0660 a lamp\n", "from 901 to 999"),
    ("external.desc", "desc: no name\n", "external.desc has no line `name: NAME`"),
    ("external.desc", "name: DDXVIDEO\n", "mine has the name of")])
def test_conflicts_between_trees_are_refused(mine: pathlib.Path, name: str, text: str, words: str) -> None:
    spoil(mine, name, text)
    with pytest.raises(BadInput, match=words):
        tables.programs()
        trees.boards()
        trees.defconfigs()
        trees.buildroot()


@pytest.mark.parametrize("tool", [["build.py"], ["buildroot.py", "image", "pc104"], ["buildroot.py", "sdk", "pc104"]])
def test_a_folder_that_is_not_there_is_one_line_and_status_2(tool: list[str], tmp_path: pathlib.Path) -> None:
    done = subprocess.run([sys.executable, "-B", TOP / "tools" / tool[0], *tool[1:]], capture_output=True, text=True,
                          env={**os.environ, "EXTERNAL": f"{tmp_path}:{tmp_path}/gone"}, check=False)
    assert done.returncode == 2
    assert f"EXTERNAL: {tmp_path} is no tree: it has no folder package, board" in done.stdout.splitlines()[-1]


def test_a_path_is_relative_to_our_tree(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("EXTERNAL", ":../gone:")
    with pytest.raises(BadInput, match=f"EXTERNAL: {TOP.parent}/gone is not there"):
        trees.others()


def test_numbers_from_950_on_belong_to_other_trees(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("EXTERNAL", raising=False)
    assert max(int(one.number) for one in tables.programs()) < 950
