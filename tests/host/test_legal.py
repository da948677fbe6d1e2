# SPDX-License-Identifier: GPL-2.0-or-later
"""`make legal` fails on a warning of legal-info about our packages, and on a gap that it does not report."""
import pathlib

import legal
import pytest

pytestmark = pytest.mark.retry

# The end of legal-info's README for the mini-ITX image.
README = """
Due to technical limitations or lack of license definition in the package
makefile, some of the material listed above could not been saved, as the
following list details.

WARNING: the Buildroot source code has not been saved
"""
OTHER = "WARNING: xz-custom: cannot save license (HOST_XZ_LICENSE_FILES not defined)\n"
OURS = "WARNING: ddx-0.1.0: cannot save license (DDX_LICENSE_FILES not defined)\n"
COLUMNS = '"PACKAGE","VERSION","LICENSE","LICENSE FILES","SOURCE ARCHIVE","SOURCE SITE","DEPENDENCIES WITH LICENSES"'
DDX = ('"ddx","0.1.0","LGPL-2.1+ (libddx), GPL-2.0+ (programs, scripts)","LICENSE LICENSES/GPL-2.0.txt","not saved","",'
       '"glibc []"')


@pytest.fixture
def folder(tmp_path: pathlib.Path) -> pathlib.Path:
    """A correct folder of legal-info."""
    (tmp_path / "README").write_text(README)
    (tmp_path / "manifest.csv").write_text(f"{COLUMNS}\n{DDX}\n")
    for name in ["licenses/ddx-0.1.0/LICENSE", "licenses/ddx-0.1.0/LICENSES/GPL-2.0.txt",
                 "sources/ddx-0.1.0/ddx-0.1.0.tar.gz"]:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    return tmp_path


def test_our_packages_are_found() -> None:
    assert {"ddx", "ddxvideo", "libdc1394"} <= set(legal.ours())


def test_packages_are_distinguished() -> None:
    assert legal.is_of("ddx-0.1.0", ["ddx"]) and legal.is_of("ddx", ["ddx"])
    assert not legal.is_of("ddxvideo-0.1.0", ["ddx"]) and not legal.is_of("", ["ddx"])


def test_a_correct_folder_passes(folder: pathlib.Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert legal.judge(folder, ["ddx"]) == []
    assert capsys.readouterr().out == ""  # we save Buildroot's source


def test_a_warning_about_ours_fails(folder: pathlib.Path) -> None:
    (folder / "README").write_text(README + OTHER + OURS)
    assert legal.judge(folder, ["ddx"]) == ["ddx-0.1.0: cannot save license (DDX_LICENSE_FILES not defined)"]


def test_a_warning_about_others_is_shown(folder: pathlib.Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "README").write_text(README + OTHER + "WARNING: something in general\n")
    assert legal.judge(folder, ["ddx"]) == []
    report = capsys.readouterr().out
    assert "warning: xz-custom: cannot save" in report and "warning: Buildroot: something in general" in report


@pytest.mark.parametrize("gone, complaint", [("licenses/ddx-0.1.0/LICENSES/GPL-2.0.txt", "licence texts missing"),
                                             ("sources/ddx-0.1.0/ddx-0.1.0.tar.gz", "source missing")])
def test_a_file_that_is_missing(folder: pathlib.Path, gone: str, complaint: str) -> None:
    (folder / gone).unlink()
    assert [complaint in text for text in legal.judge(folder, ["ddx"])] == [True]


def test_a_package_without_licence(folder: pathlib.Path) -> None:
    licence = "LGPL-2.1+ (libddx), GPL-2.0+ (programs, scripts)"
    assert licence in DDX
    (folder / "manifest.csv").write_text(f"{COLUMNS}\n{DDX.replace(licence, 'unknown')}\n")
    assert legal.judge(folder, ["ddx"]) == ["ddx: no licence"]


def test_a_package_that_is_not_listed(folder: pathlib.Path) -> None:
    assert legal.judge(folder, ["ddx", "ddxvideo"]) == ["ddxvideo: not in manifest.csv"]
