# SPDX-License-Identifier: GPL-2.0-or-later
"""After a change, Buildroot rebuilds exactly the affected parts of an earlier build, and leaves no obsolete files."""
import json
import pathlib
import shutil
from collections.abc import Callable

import pytest
from parts import trees
from parts.release import renew

pytestmark = pytest.mark.retry

CONFIG = """# a comment
BR2_EXTERNAL_DDXVIDEO_VERSION="-g0123abcd"
BR2_x86_64=y
BR2_PACKAGE_FFMPEG_DECODERS="h264"
BR2_PACKAGE_LZ4=y
BR2_ROOTFS_OVERLAY="/one/overlay"
BR2_LINUX_KERNEL_CUSTOM_CONFIG_FILE="$(BR2_EXTERNAL_DDXVIDEO_PATH)/../board/common/kernel/base.fragment"
BR2_LINUX_KERNEL_CONFIG_FRAGMENT_FILES="$(BR2_EXTERNAL_DDXVIDEO_PATH)/../board/miniitx/kernel.fragment"
"""
ALL = ["busybox-reconfigure", "cyclonedds-dirclean", "ddx-reconfigure", "ddxcatalog-reconfigure", "ddxgrow-reconfigure",
       "ddxlog-reconfigure", "ddxpanel-reconfigure", "ddxservice-reconfigure", "ddxupdate-reconfigure",
       "ddxvideo-reconfigure", "ffmpeg-reconfigure", "libdc1394-dirclean", "linux-reconfigure"]


@pytest.fixture(autouse=True)
def _ours_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Hide other trees that a run of all tests may have."""
    monkeypatch.delenv("EXTERNAL", raising=False)


def changed(before: dict[str, str], after: dict[str, str]) -> list[str]:
    return sorted(name for name in after if before[name] != after[name])


@pytest.mark.parametrize("edit, concerns", [
    (lambda text: text, []),
    (lambda text: text.replace("a comment", "another"), []),
    (lambda text: text.replace("0123abcd", "0123abcd-dirty"), []),
    (lambda text: text.replace('"h264"', '"h264 mjpeg"'), ["ffmpeg-reconfigure", "target"]),
    (lambda text: text.replace("/one/overlay", "/another/overlay"), []),  # overlays are compared with the sources
    (lambda text: text.replace("BR2_PACKAGE_LZ4=y", "# BR2_PACKAGE_LZ4 is not set"), ["clean", "target"]),
    (lambda text: text.replace("x86_64", "i386"), ["clean", "target"]),
    (lambda text: text.replace("miniitx", "pc104"), ["linux-reconfigure"])])
def test_an_option_s_change_rebuilds(edit: Callable[[str], str], concerns: list[str]) -> None:
    before, after = renew.keys(CONFIG, "1", "2"), renew.keys(edit(CONFIG), "1", "2")
    assert sorted([*after]) == sorted([*ALL, renew.CLEAN, renew.TARGET])
    assert changed(before, after) == concerns


def test_changes_of_buildroot_and_of_files_rebuild() -> None:
    before = renew.keys(CONFIG, "1", "2")
    assert changed(before, renew.keys(CONFIG, "another commit", "2")) == ["clean", "target"]
    assert changed(before, renew.keys(CONFIG, "1", "another file")) == ["target"]


def test_a_patch_rebuilds_its_package_and_ours(monkeypatch: pytest.MonkeyPatch, tmp_path: pathlib.Path) -> None:
    """Not the compiler, which takes an hour."""
    before, found = renew.keys(CONFIG, "1", "2"), trees.packages()
    copy = tmp_path / "libdc1394"
    shutil.copytree(found["libdc1394"], copy)
    (copy / "0009-another.patch").write_text("another\n")
    monkeypatch.setattr(trees, "packages", lambda: {**found, "libdc1394": copy})
    monkeypatch.setattr(trees, "foreign", dict)
    after = renew.keys(CONFIG, "1", "3")
    assert changed(before, after) == sorted(["libdc1394-dirclean", "target", *(
        name for name in ALL if name.startswith("ddx"))])
    names = list(after)
    assert names.index("libdc1394-dirclean") < names.index("ddxvideo-reconfigure")


def test_a_package_s_key_contains_those_of_its_dependencies(tmp_path: pathlib.Path) -> None:
    for name, text in [("low", "LOW_SITE_METHOD = local\n"),
                       ("middle", "MIDDLE_SITE_METHOD = local\nMIDDLE_DEPENDENCIES = low zlib\n"),
                       ("high", "HIGH_SITE_METHOD = local\nHIGH_DEPENDENCIES = middle\n"),
                       ("foreign", "FOREIGN_SITE = elsewhere\n")]:
        (tmp_path / name).mkdir()
        (tmp_path / name / f"{name}.mk").write_text(text)
    assert trees.local_packages(tmp_path.iterdir()) == {"low": ["low"], "middle": ["low", "middle"],
                                              "high": ["high", "low", "middle"]}
    assert trees.local_packages()["ddxvideo"] == ["ddx", "ddxvideo"]


WANTED = {renew.CLEAN: "1", renew.TARGET: "1", "ddx-reconfigure": "1", "linux-reconfigure": "1"}


@pytest.fixture(name="build")
def _build(tmp_path: pathlib.Path) -> pathlib.Path:
    """A build folder with the compiler and two packages built and installed."""
    (tmp_path / "target/etc").mkdir(parents=True)
    (tmp_path / "target/etc/gone").touch()
    for name, stamps in [("ddx-0.1.0", ["built", "staging_installed", "target_installed", "installed"]),
                         ("host-gcc-final-14", ["built", "host_installed", "installed"]),
                         ("host-lz4-1", ["built", "host_installed", "installed"])]:
        (tmp_path / "build" / name).mkdir(parents=True)
        for stamp in stamps:
            (tmp_path / f"build/{name}/.stamp_{stamp}").touch()
    renew.end(tmp_path, WANTED)
    return tmp_path


def stamps(build: pathlib.Path) -> set[str]:
    return {str(path.relative_to(build / "build")) for path in build.glob("build/*/.stamp_*")}


def test_without_a_change_nothing_is_rebuilt(build: pathlib.Path) -> None:
    before = stamps(build)
    assert renew.begin(build, WANTED) == []
    assert stamps(build) == before and (build / "target/etc/gone").exists()


def test_a_change_rebuilds_the_target(build: pathlib.Path) -> None:
    before = stamps(build)
    assert renew.begin(build, {**WANTED, renew.TARGET: "2", "ddx-reconfigure": "2"}) == ["ddx-reconfigure"]
    assert not (build / "target").exists()
    assert before - stamps(build) == {"ddx-0.1.0/.stamp_target_installed", "ddx-0.1.0/.stamp_installed",
                                      "host-gcc-final-14/.stamp_host_installed", "host-gcc-final-14/.stamp_installed"}


def test_an_interrupted_build_is_not_trusted(build: pathlib.Path) -> None:
    assert renew.begin(build, {**WANTED, "linux-reconfigure": "2"}) == ["linux-reconfigure"]
    assert renew.begin(build, WANTED) == ["linux-reconfigure"]  # it may have been built from either version
    renew.end(build, WANTED)
    assert renew.begin(build, WANTED) == []


def test_the_first_build_may_be_interrupted(tmp_path: pathlib.Path) -> None:
    assert renew.begin(tmp_path, WANTED) == []
    (tmp_path / "build").mkdir()
    assert renew.begin(tmp_path, WANTED) == []
    assert renew.begin(tmp_path, {**WANTED, "ddx-reconfigure": "2"}) == ["ddx-reconfigure"]


@pytest.mark.parametrize("known", [None, {**WANTED, renew.CLEAN: "2"}])
def test_an_unusable_build_is_started_from_scratch(build: pathlib.Path, known: dict[str, str] | None) -> None:
    if known is None:
        (build / ".made-of").unlink()
    else:
        (build / ".made-of").write_text(json.dumps(known))
    assert renew.begin(build, WANTED) == [renew.CLEAN]
