#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""make legal: licence texts, sources and lists for a board's image, in output/<board>/legal.

usage: legal.py BOARD

Buildroot's legal-info collects them; scripts/ adds Buildroot itself and our tree. A warning about one of our packages
is an error, other warnings are printed.
"""
import csv
import pathlib
import re
import shutil
import sys
import tarfile

import buildroot
import lint
from parts.common import OUTPUT, TOP, Failed, finish, run, say

WARNING = re.compile(r"^WARNING: (?:(\S+): )?(.*)$", re.M)
ANSWERED = "the Buildroot source code has not been saved"  # it is: see scripts()


def ours() -> list[str]:
    """Names of our packages."""
    return sorted(path.parent.name for path in (TOP / "package").glob("*/*.mk"))


def chosen(board: str) -> list[str]:
    """Our packages in the board's image."""
    config = (buildroot.output(board) / ".config").read_text().splitlines()
    return [name for name in ours() if f"BR2_PACKAGE_{name.upper().replace('-', '_')}=y" in config]


def note_overrides(board: str) -> None:
    path = buildroot.output(board) / "local.mk"
    if path.exists() and "_OVERRIDE_SRCDIR" in path.read_text():
        say(f"warning: {path} replaces sources, but the lists name Buildroot's versions")


def is_of(package: str, names: list[str]) -> bool:
    """Whether `package` (a name, or name-version) is one of the names."""
    return any(package == name or package.startswith(f"{name}-") for name in names)


def warnings(readme: str) -> list[tuple[str, str]]:
    """The warnings in legal-info's README: package (name-version, or empty) and text."""
    return [(found[1] or "", found[2]) for found in WARNING.finditer(readme) if found[2] != ANSWERED]


def gaps(folder: pathlib.Path, names: list[str]) -> list[str]:
    """Our packages without a licence, its text or its source, about which legal-info does not warn."""
    with (folder / "manifest.csv").open(newline="") as file:
        rows = {row["PACKAGE"]: row for row in csv.DictReader(file)}
    bad = [f"{package}: not in manifest.csv" for package in names if package not in rows]
    for package in set(names) & set(rows):
        row, texts = rows[package], rows[package]["LICENSE FILES"].split()
        if row["LICENSE"] in ("", "unknown"):
            bad.append(f"{package}: no licence")
        if not texts or any(not list(folder.glob(f"licenses/{package}-*/{text}")) for text in texts):
            bad.append(f"{package}: licence texts missing ({row['LICENSE FILES']})")
        if not list(folder.glob(f"sources/{package}-*/*")):
            bad.append(f"{package}: source missing")
    return sorted(bad)


def scripts(folder: pathlib.Path) -> None:
    """Archive the build scripts: the pinned Buildroot and our tree in its present state."""
    folder.mkdir()
    name = f"buildroot-{buildroot.RELEASE}"
    run(["git", "-C", buildroot.checkout(), "archive", f"--prefix={name}/", f"--output={folder}/{name}.tar.gz", "HEAD"])
    with tarfile.open(folder / "ddxvideo.tar.gz", "w:gz") as archive:
        for path in lint.files():
            archive.add(path, f"ddxvideo/{path.relative_to(TOP)}")


def judge(folder: pathlib.Path, names: list[str]) -> list[str]:
    """Print the warnings; returns those about our packages."""
    bad = gaps(folder, names)
    for package, text in warnings((folder / "README").read_text()):
        if is_of(package, names):
            bad.append(f"{package}: {text}")
        else:
            say(f"warning: {package or 'Buildroot'}: {text}")
    return bad


def make(board: str) -> pathlib.Path:
    folder = OUTPUT / board / "legal"
    shutil.rmtree(folder, ignore_errors=True)
    buildroot.make(board, "legal-info", f"LEGAL_INFO_DIR={folder}", show=False)
    scripts(folder / "scripts")
    sums = run(["sha256sum", *sorted(path.relative_to(folder) for path in (folder / "scripts").iterdir())], cwd=folder)
    with (folder / "legal-info.sha256").open("a") as file:
        file.write(sums)
    note_overrides(board)
    bad = judge(folder, chosen(board))
    if bad:
        raise Failed("\n  ".join(["our packages are not in order:", *bad]))
    return folder


def main() -> int:
    if len(sys.argv) != 2:
        print(__doc__, file=sys.stderr)
        return 2
    folder = make(sys.argv[1])
    with (folder / "manifest.csv").open() as file:
        packages = sum(1 for _ in file) - 1
    size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    say(f"legal: {packages} packages of the image, {size >> 20} MiB with all sources: {folder.relative_to(TOP)}")
    return 0


if __name__ == "__main__":
    finish("legal", main)
