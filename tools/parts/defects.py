# SPDX-License-Identifier: GPL-2.0-or-later
"""Ways to break the product: the patches in tests/defects, each with the tests that must turn red.

A patch begins with one sentence, and for each test with a line `Test:` and a line `Says:`, a pattern in what the test
then prints. Most patches are former defects: tools/defects.py applies one at a time. Those with `ddx_broken("name")`,
their own name, are in one copy of the packages together; the tests' programs are built from it, and DDX_BROKEN=name in
their environment switches one on.
"""
import dataclasses
import pathlib
import re
import shutil
import subprocess

from parts.common import OUTPUT, TOP, Failed, alone, fingerprint, run, scratch, step

FOLDER = TOP / "tests/defects"
COPY = OUTPUT / "broken"  # has `package` with all switches


@dataclasses.dataclass(frozen=True)
class Defect:
    path: pathlib.Path
    title: str
    tests: list[tuple[str, str]]  # a test and its words. Test: of pytest, as on its command line; `C: name` of meson;
    #                               `fuzz: target`; else a program below output/desk, with its arguments
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
    """Apply a patch to another copy of our tree; lines may have moved, but not changed."""
    done = subprocess.run(["patch", "-p1", "--force", "--fuzz=0", "--no-backup-if-mismatch", "--reject-file=-",
                           f"--input={defect.path}"], cwd=tree, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                          text=True, check=False)
    if done.returncode:
        raise Failed(f"tests/defects/{defect.path.name} does not apply: {done.stdout}")


def copy() -> None:
    """Write COPY; a file whose content stays keeps its time, so little is built again."""
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
