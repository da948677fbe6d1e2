# SPDX-License-Identifier: GPL-2.0-or-later
"""BusyBox has exactly the applets and options that manifest.txt and busybox.config list."""
import pathlib

import pytest

from parts.common import Failed, entries, run
from parts.image import busybox
from parts.image.archive import Archive

pytestmark = [pytest.mark.retry, pytest.mark.computes]


@pytest.fixture(scope="module")
def listed() -> set[str]:
    """The applets that the development image's BusyBox lists, except itself."""
    return set(run([busybox.busybox() / "bin/busybox", "--list"]).split()) - {"busybox"}


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    folder = tmp_path_factory.mktemp("source") / "busybox"
    Archive().source("busybox", folder)
    return folder


def spoil(name: str, text: str, folder: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Replace one of busybox's two files."""
    path = folder / getattr(busybox, name).name
    path.write_text(text)
    monkeypatch.setattr(busybox, name, path)


def test_applets_are_those_of_the_manifest(listed: set[str]) -> None:
    assert listed == set(busybox.applets())
    assert len(busybox.applets()) == len(listed)  # each is listed once


@pytest.mark.parametrize("old, new, differs", [("", "applet seedrng\n", {"seedrng"}),
                                               ("applet hwclock adjtimex", "applet hwclock", {"adjtimex"})])
def test_a_changed_applet_list_is_found(listed: set[str], tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch,
                                old: str, new: str, differs: set[str]) -> None:
    """Proves that the check can fail: the manifest has one applet more, or one less."""
    spoil("MANIFEST", busybox.MANIFEST.read_text().replace(old, new, 1), tmp_path, monkeypatch)
    assert listed ^ set(busybox.applets()) == differs


def test_an_unknown_applet_is_reported(source: pathlib.Path, tmp_path: pathlib.Path,
                                   monkeypatch: pytest.MonkeyPatch) -> None:
    spoil("MANIFEST", "applet ls lls\n", tmp_path, monkeypatch)
    with pytest.raises(Failed, match="^manifest.txt: BusyBox has no applet lls$"):
        busybox.configure(source, ["make"])


def test_each_listed_option_changes_the_configuration(source: pathlib.Path, tmp_path: pathlib.Path,
                                   monkeypatch: pytest.MonkeyPatch) -> None:
    """None of the options would be set without the list. Missing options are reported: an unknown one, one whose
    applet is off, and two applets that need options of the list."""
    wanted = entries(busybox.CONFIG)
    assert len(wanted) == len({line.split("=")[0] for line in wanted})
    spoil("CONFIG", "CONFIG_FEATURE_LS_COLOURS=y\nCONFIG_NC_SERVER=y\n", tmp_path, monkeypatch)
    with pytest.raises(Failed) as error:
        busybox.configure(source, ["make"])
    assert str(error.value).split()[3:] == [f"CONFIG_{name}=y" for name in
                                           ("FEATURE_LS_COLOURS", "NC_SERVER", "NOLOGIN", "PING6")]
    assert set(wanted) & set((source / ".config").read_text().splitlines()) == set()
