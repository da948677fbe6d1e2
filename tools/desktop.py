#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""Install the development files: desktop.py PREFIX [DESTDIR]

Headers, libraries, pkg-config files, programs, the Python module `ddx`, and a man page for each program and call; no
services. Built as the user; sudo is used for the installation alone, if the user may not write there.
"""
import getpass
import json
import os
import pathlib
import shlex
import shutil
import site
import subprocess
import sys

from parts.common import OUTPUT, TOP, Failed, finish, output, run, say
from parts.image import native
from parts.release import manual

FOLDERS = ("bin", "include", "lib", "share")  # below the prefix
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


def privileges(prefix: str, destination: str) -> list[str]:
    """The words before a command that writes there: none, or sudo. Fails, before the build, if neither works."""
    place = pathlib.Path(f"{destination}{prefix}")
    while not place.exists():
        place = place.parent
    if os.access(place, os.W_OK) and all(os.access(one, os.W_OK) for one in place.glob("*") if one.name in FOLDERS):
        return []
    instead = "type `make desktop` as root, or choose a folder of yours: make desktop PREFIX=$HOME/ddx"
    if not shutil.which("sudo"):
        raise Failed(f"only root may write to {place}, and there is no sudo: {instead}")
    if subprocess.run(["sudo", "-n", "true"], capture_output=True, check=False).returncode:
        say(f"desktop: sudo is needed for the installation in {place}")
        if subprocess.run(["sudo", "-v"], check=False).returncode:
            raise Failed(f"{getpass.getuser()} may not use sudo: {instead}")
    return ["sudo"]


def build(prefix: str, stage: pathlib.Path) -> None:
    """Build the packages for that prefix, and install them below `stage`."""
    desk = native.for_desktop()
    installed = []
    for package in native.PACKAGES:
        if package in ("ddxgrow", "ddxpanel", "ddxservice", "ddxupdate"):  # for an appliance only
            continue
        sources, out = TOP / "package" / package, OUTPUT / "desktop" / package
        options = [f"--prefix={prefix}"]  # the last prefix counts
        if package == "ddx":
            options.append(f"-Dpython_folder={python_folder(prefix)}")
        if package == "ddxvideo":
            options.append("-Ddesk_tools=true")
        say(f"desktop: {package} ...")
        native.compile_package(out, sources, options, native.environment(desk))
        run(["meson", "install", "--no-rebuild", "--tags", TAGS, "-C", out],
            env={**native.environment(desk), "DESTDIR": str(stage)})
        installed += programs(out, prefix, str(stage))
    say("desktop: man pages ...")
    manual.write(pathlib.Path(f"{stage}{prefix}/share/man"), installed, native.environment(desk))


def install(prefix: str, destination: str) -> None:
    sudo = privileges(prefix, destination)
    stage = OUTPUT / "desktop/stage"
    shutil.rmtree(stage, ignore_errors=True)
    build(prefix, stage)
    # Copied in one step, so that only this step needs sudo. The owner is then root, and folders that are there, such as
    # /usr/local/lib of group staff, keep their modes: cp --preserve would change them.
    target = pathlib.Path(destination or "/")
    run([*sudo, "mkdir", "-p", target])
    run([*sudo, "cp", "-R", "--no-dereference", f"{stage}/.", target])
    if not destination and (sudo or os.geteuid() == 0):
        run([*sudo, "ldconfig"])
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
    os.umask(0o022)  # what is installed is for all users
    install(prefix.rstrip("/") or "/", destination)
    if not destination:
        search_path(prefix)
    return 0


if __name__ == "__main__":
    finish("desktop", main)
