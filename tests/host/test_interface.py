# SPDX-License-Identifier: GPL-2.0-or-later
"""The library exports exactly what its public headers declare, so that a program cannot depend on anything else."""
import pathlib
import re
import subprocess

import pytest

from parts.common import TOP, run
from parts.image import native

pytestmark = pytest.mark.retry

HEADERS = sorted((TOP / "package/ddx/include").glob("*.h"))


def exported(library: pathlib.Path) -> set[str]:
    return {line.split()[-1] for line in run(["nm", "-D", "--defined-only", library]).splitlines()}


def declared(headers: list[pathlib.Path]) -> set[str]:
    """Functions and variables at file level after preprocessing, without static ones."""
    source = "".join(f'#include "{path}"\n' for path in headers)
    text = subprocess.run(["gcc", "-E", "-P", "-x", "c", "-"], input=source, capture_output=True, text=True,
                          check=True).stdout
    while (flat := re.sub(r"\{[^{}]*\}", " BODY ", text)) != text:
        text = flat
    statements = [one for one in re.split(r";|BODY(?! *\w)", text) if "typedef" not in one and "static" not in one]
    return {found[1] for one in statements if (found := re.search(r"\b(ddx_\w+) *[(\[]", one))}


def test_the_library_exports_what_its_headers_declare() -> None:
    names = declared(HEADERS)
    assert len(names) > 50 and {"ddx_store_open", "ddx_error_text", "ddx_requests_take"} <= names
    library = native.build() / native.LIBRARIES / "libddx.so"
    assert exported(library) == names


@pytest.mark.parametrize("source, extra", [("int ddx_new(void); int ddx_new(void) { return 0; }", {"ddx_new"}),
                                           ("int helper; static int own; int *at(void) { return &own; }",
                                            {"helper", "at"})])
def test_an_additional_symbol_is_found(tmp_path: pathlib.Path, source: str, extra: set[str]) -> None:
    (tmp_path / "more.c").write_text(source)
    run(["gcc", "-shared", "-fPIC", tmp_path / "more.c", "-o", tmp_path / "more.so"])
    assert exported(tmp_path / "more.so") - declared(HEADERS) == extra
