# SPDX-License-Identifier: GPL-2.0-or-later
"""`make sbom`, compared with the contents of the images that Buildroot made here."""
import copy
import json
import pathlib

import buildroot
import legal
import pytest
import sbom
from parts.common import OUTPUT, Failed

pytestmark = pytest.mark.retry

ELF = b"\x7fELF" + bytes(60)


def part(name: str, licence: str, kind: str = "target") -> sbom.Sbom:
    return {"name": name, "version": "1", "licenses": [{"license": {"name": licence}}],
            "properties": [{"name": "BR_TYPE", "value": kind}]}


def test_gaps_are_found() -> None:
    good = {"components": [part("ddx", "LGPL-2.1+"), part("ddxvideo", "GPL-2.0+"), part("cc", "GPL-3.0+", "host")]}
    assert sbom.gaps(good, ["ddx", "ddxvideo"]) == []
    assert sbom.gaps(good, ["ddx", "cc"]) == ["cc is not in the SBOM"]
    changes: list[tuple[sbom.Sbom, str]] = [
        ({"version": ""}, "ddx: no version"), ({"licenses": []}, "ddx: no licence"),
        ({"licenses": [{"license": {"name": "unknown"}}]}, "ddx: no licence")]
    for change, gap in changes:
        bad = copy.deepcopy(good)
        bad["components"][0] |= change
        assert sbom.gaps(bad, ["ddx", "ddxvideo"]) == [gap]


def test_code_of_unknown_origin_is_found(tmp_path: pathlib.Path) -> None:
    for name in ["usr/bin/store", "usr/lib/libx.so.1", "usr/bin/script", "boot/vmlinuz", "lib/modules/6/a.ko.xz"]:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(ELF if "usr" in name and "script" not in name else b"#!/bin/sh\n")
    (tmp_path / "usr/lib/libx.so").symlink_to("libx.so.1")
    listed = {"components": [part("ddx", "GPL-2.0+"), part("linux", "GPL-2.0"), part("x", "MIT", "host")]}
    owners = ["ddx,./usr/bin/store", "linux,./boot/vmlinuz", "linux,./lib/modules/6/a.ko.xz", "x,./usr/lib/libx.so.1"]
    x = "usr/lib/libx.so.1 of x"
    assert sbom.unknown(listed, tmp_path, "\n".join(owners)) == [x]
    assert sbom.unknown(listed, tmp_path, "\n".join(owners[1:])) == ["usr/bin/store of nobody", x]
    (tmp_path / "empty").mkdir()
    with pytest.raises(Failed):
        sbom.unknown(listed, tmp_path / "empty", "")


def test_another_list_of_licences_is_refused(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "cyclonedx" / sbom.SCHEMA
    path.parent.mkdir()
    path.write_text('{"enum": ["MIT"]}')
    with pytest.raises(Failed, match="not the one expected"):
        sbom.schema(tmp_path)


@pytest.mark.parametrize("board", buildroot.boards())
def test_an_image_s_contents_are_listed(board: str) -> None:
    build, root = buildroot.output(board), OUTPUT / board / "root"
    owners = build / "build/packages-file-list.txt"
    if not (owners.exists() and root.exists() and buildroot.present()):
        pytest.skip(f"{board}: not built by Buildroot here, so its SBOM was not compared with the image")
    ours = legal.chosen(board)
    assert {"ddx", "ddxvideo"} <= set(ours)
    listed = json.loads(sbom.make(board).read_text())
    assert sbom.gaps(listed, [*ours, "linux", "busybox", "grub2", "glibc"]) == []
    assert sbom.unknown(listed, root, owners.read_text()) == []
    assert "genimage" in {name.removeprefix("host-") for name in sbom.components(listed, "host")}
    assert not [name for name in sbom.components(listed, "target") if name.startswith("host-")]
    for name in [*ours, "busybox", "linux", "glibc"]:  # missing entries are found
        less = listed | {"components": [one for one in listed["components"] if one["name"] != name]}
        assert sbom.unknown(less, root, owners.read_text()), name
