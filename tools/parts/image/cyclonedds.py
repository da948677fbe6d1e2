# SPDX-License-Identifier: GPL-2.0-or-later
"""Cyclone DDS for the catalog of the desk and of the development image.

Debian's version has no types that are made at run time, and a heap overflow by a packet. Rust's package registry has
the very source that the product is built from, inside of a package for Rust. A static library, as libsrtp2 is. The
patches are the product's, too.
"""
import hashlib
import os
import pathlib
import re
import tempfile

from parts.common import TOP, Failed, fingerprint, run
from parts.image import foreign, srtp

PACKAGE = TOP / "package/cyclonedds/cyclonedds.mk"
CRATE = "eclipse-cyclonedds-sys"
VERSION = "0.0.4"
DIGEST = "0783f6ac34434838e511d3e2f16a35c1d392856ccf8d6165334aa589a94cbcd8"
PROJECT = f"""[package]
name = "source"
version = "0.0.0"
edition = "2021"

[dependencies]
{CRATE} = "={VERSION}"
"""


def options() -> list[str]:
    """The product's choice of parts."""
    return re.findall(r"-D\w+=\w+", PACKAGE.read_text())


def download(folder: pathlib.Path) -> pathlib.Path:
    """The crate, by cargo, which keeps what it downloads below its home."""
    home, project = pathlib.Path(os.environ.get("CARGO_HOME", "~/.cargo")).expanduser(), folder / "project"
    (project / "src").mkdir(parents=True)
    (project / "src/lib.rs").touch()
    (project / "Cargo.toml").write_text(PROJECT)
    run(["cargo", "fetch"], cwd=project)
    crate = next(home.glob(f"registry/cache/*/{CRATE}-{VERSION}.crate"))
    if hashlib.sha256(crate.read_bytes()).hexdigest() != DIGEST:
        raise Failed(f"{crate.name} is not the one expected")
    return crate


def patches() -> list[pathlib.Path]:
    return sorted(PACKAGE.parent.glob("*.patch"))


def unpack(folder: pathlib.Path) -> pathlib.Path:
    """The source, patched."""
    run(["tar", "-xf", download(folder), "-C", folder])
    source = folder / f"{CRATE}-{VERSION}/vendor/cyclonedds-c"
    for patch in patches():
        run(["patch", "-p1", "--fuzz=0", f"--input={patch}"], cwd=source)
    return source


def build(tree: pathlib.Path) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        source, into = unpack(folder), folder / "build"
        place = ["-DCMAKE_INSTALL_PREFIX=/usr", f"-DCMAKE_INSTALL_LIBDIR={srtp.LIBRARIES.removeprefix('usr/')}"]
        run(["cmake", "-S", source, "-B", into, "-DCMAKE_BUILD_TYPE=Release", *place, *options()])
        run(["cmake", "--build", into, "--target", "ddsc", f"-j{os.cpu_count()}"])
        run(["cmake", "--install", into], env={"DESTDIR": str(tree)})
    run(["rm", "-rf", tree / "usr/bin", tree / "usr/share"])


def cyclonedds() -> pathlib.Path:
    """An install tree: headers, libddsc.a and its pkg-config file. The network is needed the first time only."""
    compiler = run(["dpkg-query", "-W", "-f", "${Package} ${Version}\\n", *foreign.COMPILER])
    return foreign.kept("cyclonedds", fingerprint([pathlib.Path(__file__), *patches()], compiler, *options()), build)
