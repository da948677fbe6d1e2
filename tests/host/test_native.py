# SPDX-License-Identifier: GPL-2.0-or-later
"""How packages are compiled on this machine."""
from __future__ import annotations

import pathlib
import subprocess

import pytest

from parts.common import TOP, run
from parts.image import native

pytestmark = pytest.mark.retry


def hits() -> int:
    """Compilations that ccache had the result of."""
    shown = dict(line.split("\t") for line in run(["ccache", "--print-stats"], env=native.CCACHE).splitlines())
    return int(shown["direct_cache_hit"]) + int(shown["preprocessed_cache_hit"])


def test_a_clone_takes_over_what_another_one_compiled(tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the other clone's paths. A changed header is noticed."""
    meson = native.MESON
    monkeypatch.setattr(native, "CCACHE", {**native.CCACHE, "CCACHE_DIR": str(tmp_path / "cache")})
    for clone, expected in ("first", 0), ("second", 1):
        top = tmp_path / clone
        sources, out = top / "package/word", top / "output/desk/word"
        sources.mkdir(parents=True)
        (sources / "meson.build").write_text("project('word', 'c')\nexecutable('word', 'main.c')\n")
        (sources / "main.c").write_text('#include "word.h"\nint main(void) { return WORD; }\n')
        (sources / "word.h").write_text("#define WORD 0\n")
        monkeypatch.setattr(native, "MESON", [word.replace(str(TOP), str(top)) for word in meson])
        monkeypatch.setitem(native.CCACHE, "CCACHE_BASEDIR", str(top))
        assert native.compile_package(out, sources, [], {}) and hits() == expected
        info = run(["readelf", "--debug-dump=info", out / "word"])
        assert "../../../package/word/main.c" in info and str(tmp_path) not in info
    (sources / "word.h").write_text("#define WORD 1\n")
    assert native.compile_package(out, sources, [], {}) and hits() == 1
    assert subprocess.run([out / "word"], check=False).returncode == 1
