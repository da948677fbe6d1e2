# SPDX-License-Identifier: GPL-2.0-or-later
"""Manual pages: each program and each public call has one, troff finds no fault, and their text is shown."""
from __future__ import annotations

import pathlib
import re
import subprocess

import pytest

from parts.common import TOP, entries, run
from parts.image import native
from parts.release import manual, manual_calls, manual_programs

pytestmark = pytest.mark.retry

# Only in the appliance.
NOT_ON_A_DESK = {"serial", "confine", "launch", "ddxgrow", "ddxpanel", "ddxupdate", "panel-certificate"}


def programs() -> set[str]:
    """The programs of the tables, by their names in the meson.build of the folder or package."""
    found = set()
    for table in (TOP / "package").glob("*/programs.txt"):
        for line in entries(table):
            folder = table.parent / line.split()[0]
            build = folder if (folder / "meson.build").exists() else table.parent
            found |= set(re.findall(r"\bexecutable\('([\w-]+)'", (build / "meson.build").read_text()))
            found |= set(re.findall(r"rename: '(ddxvideocalib)'", (build / "meson.build").read_text()))
    return {name for name in found - NOT_ON_A_DESK if "test" not in name and not name.startswith("ctl-")
            and name not in ("bench", "encode", "view")}


def calls() -> set[str]:
    """The public functions of the libraries, by their symbols."""
    libraries = native.build() / native.LIBRARIES
    found = set(run(["nm", "-D", "--defined-only", "--format=just-symbols", libraries / "libddx.so"]).split())
    static = run(["nm", "-g", "--defined-only", "--format=just-symbols", libraries / "libddxvideo.a"]).split()
    header = (manual.HEADERS["ddxvideo"] / "ddxvideo.h").read_text()
    found |= {name for name in static if f"{name}(" in header}
    return {name for name in found if not name.endswith("_")}


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    """The pages of the desk's programs, as made by `make desktop`."""
    root = native.build()
    tools = tmp_path_factory.mktemp("bin")
    (tools / "ddxvideocalib").symlink_to(TOP / "package/ddxvideo/stereo/calibrate.py")
    folder = tmp_path_factory.mktemp("man")
    manual.write(folder, [*(root / "usr/bin").iterdir(), tools / "ddxvideocalib"], native.environment(root))
    return folder


def shown(pages: pathlib.Path, page: str) -> str:
    """The page as on a terminal, without bold."""
    text = run(["groff", "-man", "-ww", "-Tascii", "-P-cbou", pages / page], cwd=pages)
    return re.sub(r"\s+", " ", text)


def test_each_program_has_a_page(pages: pathlib.Path) -> None:
    names = programs()
    assert {"ddxstore", "ddxctl", "ddxlog", "ddxcatalog", "ddxdecode", "ddxvideo1394", "ddxvideocalib"} <= names
    assert names <= {path.stem for path in (pages / "man1").iterdir()}


def test_each_call_has_a_page(pages: pathlib.Path) -> None:
    names = calls()
    assert len(names) > 60 and {"ddx_store_open", "ddx_stats_out_numbered", "ddxvideo_view_any"} <= names
    assert names | {"DDX_STORE_TYPE"} == {path.stem for path in (pages / "man3").iterdir()} - {
        path.name for folder in manual.HEADERS.values() for path in folder.glob("*.h")}


def test_troff_finds_no_fault(pages: pathlib.Path) -> None:
    files = sorted(pages.rglob("*.[13]"))
    done = subprocess.run(["groff", "-man", "-ww", "-Tutf8", "-z", *files], cwd=pages, capture_output=True, text=True,
                          check=False)
    assert len(files) > 90 and (done.returncode, done.stderr) == (0, "")


def test_each_page_has_a_name_for_apropos(pages: pathlib.Path) -> None:
    for path in pages.rglob("*.[13]"):
        text = path.read_text()
        assert text.startswith(".so man") or re.search(rf"^\.SH NAME\n{path.stem}.* \\- \S.+$", text, re.MULTILINE)


def test_each_option_is_in_the_page(pages: pathlib.Path) -> None:
    """For a handwritten help, a common one, and that of a Python program."""
    root = native.build()
    for program in "ddxctl", "ddxvideosave", "ddxvideosend":
        text = manual.help_text(root / "usr/bin" / program, native.environment(root))
        page = shown(pages, f"man1/{program}.1")
        options = re.findall(r"^  (-[\w-]+)", text, re.MULTILINE)
        assert len(options) > 4 and [option for option in options if f" {option} " not in page] == []
        assert "EXIT STATUS" in page and "options (" not in page
    assert "-square METRES" in shown(pages, "man1/ddxvideocalib.1")


def test_a_call_s_page_shows_the_text_of_its_header(pages: pathlib.Path) -> None:
    page = shown(pages, "man3/ddx_store_acquire.3")
    assert "int ddx_store_acquire(DDX_STORE_ITEM *item, struct ddx_frame *frame, double timeout, int tail);" in page
    assert "Hold a value without copying it: the value cannot change until ddx_store_release()." in page
    assert "uint64_t missed; /*" in page and "ddx.h(3)" in page
    assert "RETURN VALUE 0, or a negative error number (-errno). ERRORS -EBUSY no memory left for another" in page
    assert "-ETIMEDOUT nothing was written within the timeout" in page  # as ddx_store_read()
    count = shown(pages, "man3/ddx_store_readers.3")
    assert "RETURN VALUE Number of readers that the item of this writing handle has now. -EINVAL if" in count
    assert "ERRORS" not in shown(pages, "man3/ddx_store_missed.3")
    assert shown(pages, "man3/ddx_store_item_type.3") == shown(pages, "man3/ddx_store_item_name.3")
    overview = shown(pages, "man3/ddx.h.3")
    assert "-EHOSTUNREACH the catalog has not heard from a machine of this name" in overview
    assert "DDX_IN_ORDER = -1" in overview
    assert "SAMPLE y[MAX];" in shown(pages, "man3/ddxvideo.h.3") and "declaration_" not in overview


HEADER = """/*
 * small: an example.
 *   errors     int functions return 0, or -errno:
 *                -ENOENT  there are none,
 *                         at all
 */
/* Count `things`:
 *   -EINVAL  too
 *            many
 * else the number. A line of
 * .dots and 'quotes', a \\\\ and "-x". Returns the number, or -ENOENT.
 */
int ddx_count(int things);

/* The same for others. */
int ddx_count_more(int things);

/* Not for programs. */
int ddx_private_(void);
"""


def test_comments_become_pages() -> None:
    found = manual_calls.pages({"small.h": HEADER}, "ddx", "1")
    assert set(found) == {"small.h", "ddx_count", "ddx_count_more"}
    assert found["ddx_count_more"] == ".so man3/ddx_count.3\n" and "The same for others." in found["ddx_count"]
    assert ".TP\n\\fB\\-EINVAL\\fR\ntoo many\n" in found["ddx_count"] and "\\e" in found["ddx_count"]
    result, errors = found["ddx_count"].partition(".SH RETURN VALUE\n")[2].split(".SH ")[:2]
    assert result == "Returns the number, or \\-ENOENT.\n"
    assert errors.startswith("ERRORS\n.TP\n\\fB\\-EINVAL\\fR\ntoo many\n"
                             ".TP\n\\fB\\-ENOENT\\fR\nthere are none, at all\n")


def test_help_becomes_a_page() -> None:
    text = ("usage: x FILE\n       x -list\n\nDoes this.\n\noptions:\n  -a N   first\n         more\n"
            "  -start yes|no begins\n\nExit status: 0.\n")
    page = manual_programs.program_page("x", "an example", text, ["store"], "1")
    titles = ["NAME", "SYNOPSIS", "DESCRIPTION", "OPTIONS", "EXIT STATUS", "SEE ALSO"]
    assert re.findall(r"^\.SH (.*)", page, re.MULTILINE) == titles
    assert ".TP\n\\fB\\-a N\\fR\nfirst more\n.TP\n\\fB\\-start yes|no\\fR\nbegins\n" in page
    assert '.B "x FILE"\n' in page and '.B "x \\-list"\n' in page
