#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""Install the development files: desktop.py PREFIX [DESTDIR]

Headers, libraries, pkg-config files, programs, the Python module `ddx`, and a man page for each program and call; no
services.
"""
import json
import os
import pathlib
import shlex
import site
import sys

from parts.common import OUTPUT, TOP, Failed, finish, output, run, say
from parts.image import native
from parts.release import manual

TAGS = "runtime,devel,python-runtime"


def python_folder(prefix: str) -> str:
    """The folder below the prefix that Python searches; else the usual one for PYTHONPATH."""
    for folder in site.getsitepackages():
        if pathlib.Path(folder).is_relative_to(prefix):
            return folder
    return f"{prefix}/lib/python3/site-packages"


def programs(built: pathlib.Path, prefix: str, destination: str) -> list[pathlib.Path]:
    """The programs that meson installs from there for users."""
    files = json.loads((built / "meson-info/intro-installed.json").read_text()).values()
    folder = pathlib.Path(prefix, "bin")
    return [pathlib.Path(destination + file) for file in files if pathlib.Path(file).parent == folder]


def install(prefix: str, destination: str) -> None:
    # ddxvideo is built with the ddx of the desk build, which does not depend on the prefix.
    desk = native.build()
    installed = []
    for package in native.PACKAGES:
        if package in ("ddxgrow", "ddxservice"):  # for an appliance's disk and services only
            continue
        out = OUTPUT / "desktop" / package
        options = [*native.MESON, f"--prefix={prefix}", "-Dtests=false"]  # the last prefix counts
        if package == "ddx":
            options.append(f"-Dpython_folder={python_folder(prefix)}")
        if package == "ddxvideo":
            options.append("-Ddesk_tools=true")
        env = {**native.environment(desk), "DESTDIR": destination}
        again = ["--reconfigure"] if (out / "build.ninja").exists() else []
        run(["meson", "setup", *again, *options, out, TOP / "package" / package], env=env)
        run(["ninja", "-C", out], env=env)
        run(["meson", "install", "--no-rebuild", "--tags", TAGS, "-C", out], env=env)
        installed += programs(out, prefix, destination)
    manual.write(pathlib.Path(f"{destination}{prefix}/share/man"), installed, native.environment(desk))
    if not destination and os.geteuid() == 0:
        run(["ldconfig"])
    say(f"desktop: installed in {destination}{prefix}")


def search_path(prefix: str) -> None:
    """Print hints if programs would not find the installed files."""
    if python_folder(prefix) not in site.getsitepackages():
        say(f"desktop: for Python: export PYTHONPATH={shlex.quote(python_folder(prefix))}")
    if f"{prefix}/lib" not in output(["ldconfig", "-p"]):
        say(f"desktop: for programs: export LD_LIBRARY_PATH={shlex.quote(prefix + '/lib/x86_64-linux-gnu')}")


def main() -> int:
    prefix = sys.argv[1] if len(sys.argv) > 1 else "/usr/local"
    destination = sys.argv[2] if len(sys.argv) > 2 else ""
    if not prefix.startswith("/") or destination and not destination.startswith("/"):
        raise Failed("PREFIX and DESTDIR are absolute paths")
    install(prefix.rstrip("/") or "/", destination)
    if not destination:
        search_path(prefix)
    return 0


if __name__ == "__main__":
    finish("desktop", main)
