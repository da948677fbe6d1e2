# SPDX-License-Identifier: GPL-2.0-or-later
"""The patches in tests/defects, which break the product, each with the tests that must fail.

A patch begins with one sentence, and has for each test a line `Test:` and a line `Says:`, a pattern in the test's
output. Most patches are former defects: tools/defects.py applies one at a time. Patches with `ddx_broken("name")`,
their own name, are all applied to one copy of the packages, from which test programs are built; DDX_BROKEN=name in the
environment switches one on.
"""
import dataclasses
import pathlib
import re
import shutil
import subprocess

from parts.common import OUTPUT, TOP, Failed, alone, fingerprint, run, scratch, step

FOLDER = TOP / "tests/defects"
COPY = OUTPUT / "broken"  # with `package`, all switches included


@dataclasses.dataclass(frozen=True)
class Defect:
    path: pathlib.Path
    title: str
    tests: list[tuple[str, str]]  # a test, and a pattern in its output. The test is an argument of pytest, `C: name`
    #                               for meson, `fuzz: target`, or a program below output/desk with its arguments
    files: list[str]
    switched: bool

    @property
    def name(self) -> str:
        return self.path.stem


def read(path: pathlib.Path) -> Defect:
    text = path.read_text()
    return Defect(path, text.splitlines()[0], re.findall(r"^Test: (.+)\nSays: (.+)$", text, re.MULTILINE),
                  re.findall(r"^\+\+\+ b/(.+)$", text, re.MULTILINE), f'ddx_broken("{path.stem}")' in text)


DEFECTS = [read(path) for path in sorted(FOLDER.glob("*.patch"))]


def plant(defect: Defect, tree: pathlib.Path) -> None:
    """Apply a patch to a copy of our tree; context lines may have moved, but not changed."""
    done = subprocess.run(["patch", "-p1", "--force", "--fuzz=0", "--no-backup-if-mismatch", "--reject-file=-",
                           f"--input={defect.path}"], cwd=tree, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                          text=True, check=False)
    if done.returncode:
        raise Failed(f"tests/defects/{defect.path.name} does not apply: {done.stdout}")


def copy() -> None:
    """Write COPY; unchanged files keep their times, so little is built again."""
    def write() -> None:
        with scratch() as folder:
            shutil.copytree(TOP / "package", folder / "package")
            for defect in DEFECTS:
                if defect.switched:
                    plant(defect, folder)
            run(["rsync", "-a", "--no-times", "--checksum", "--delete", f"{folder}/package", COPY])

    COPY.mkdir(parents=True, exist_ok=True)
    with alone("defects", OUTPUT / "broken.lock"):
        step("copy with defects", OUTPUT / "broken.stamp", fingerprint([TOP / "package", FOLDER]), write)
