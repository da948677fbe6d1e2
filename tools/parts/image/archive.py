# SPDX-License-Identifier: GPL-2.0-or-later
"""Debian's archive with our own package lists: packages are downloaded and unpacked without changing the host."""
import contextlib
import fcntl
import functools
import pathlib
import re
import subprocess
from collections.abc import Iterator

from parts.common import CACHE, Failed, run, say

KEYRING = "/usr/share/keyrings/debian-archive-keyring.gpg"
SUITES = ["bookworm", "bookworm-backports"]


def _mirror() -> str:
    """The Debian mirror of this machine's apt."""
    etc = pathlib.Path("/etc/apt")
    for path in [etc / "sources.list", *sorted((etc / "sources.list.d").glob("*"))]:
        if path.is_file():
            lines = [line for line in path.read_text(errors="replace").splitlines() if not line.startswith("#")]
            for uri in re.findall(r"\w+:/[^\s\]]+", "\n".join(lines)):
                if uri.rstrip("/").endswith("/debian"):
                    return str(uri.rstrip("/"))
    raise Failed("found no Debian archive in /etc/apt/sources.list or sources.list.d")


class Archive:
    def __init__(self, folder: pathlib.Path = CACHE / "apt") -> None:
        self.folder = folder

    @functools.cached_property
    def _options(self) -> list[str]:
        for name in ["lists/partial", "archives/partial", "empty"]:
            (self.folder / name).mkdir(parents=True, exist_ok=True)
        sources = self.folder / "sources.list"
        mirror = _mirror()
        lines = [f"deb [signed-by={KEYRING} target=Packages] {mirror} {suite} main\n" for suite in SUITES]
        lines.append(f"deb-src [signed-by={KEYRING} target=Sources] {mirror} {SUITES[0]} main\n")
        options = ["-q", "-o", f"Dir::Etc::sourcelist={sources}", "-o", f"Dir::Etc::sourceparts={self.folder}/empty",
                   "-o", f"Dir::State::lists={self.folder}/lists", "-o", f"Dir::Cache={self.folder}",
                   "-o", "APT::Sandbox::User=", "-o", "Acquire::Languages=none",
                   "-o", "APT::Update::Post-Invoke-Success::=true"]
        with self._locked(fcntl.LOCK_EX):
            changed = not sources.exists() or sources.read_text() != "".join(lines)
            if changed or not any((self.folder / "lists").glob("*_Packages*")):
                say("reading Debian's package lists ...")
                sources.write_text("".join(lines))
                run(["apt-get", *options, "update"])
        return options

    @contextlib.contextmanager
    def _locked(self, how: int) -> Iterator[None]:
        """Downloads may run side by side (LOCK_SH), but not beside an update of the lists (LOCK_EX)."""
        with (self.folder / "busy").open("w") as file:
            fcntl.flock(file, how)
            yield

    def newest(self, pattern: str) -> str:
        """The package with the highest version whose name matches the pattern."""
        found = run(["apt-cache", *self._options, "search", "--names-only", f"^{pattern}$"])
        names = [line.split()[0] for line in found.splitlines() if " - " in line]
        if not names:
            raise Failed(f"Debian's archive holds no package {pattern}")
        return sorted(names, key=lambda name: [int(n) for n in re.findall(r"\d+", name)])[-1]

    def version(self, source: str) -> str:
        """The archive's version of a source package, or its versions."""
        text = run(["apt-cache", *self._options, "showsrc", "--only-source", source])
        versions = re.findall(r"^Version: (\S+)$", text, re.MULTILINE)
        if not versions:
            raise Failed(f"Debian's archive holds no source {source}")
        return " ".join(versions)

    def _get(self, words: list[str], into: pathlib.Path) -> None:
        into.mkdir(parents=True, exist_ok=True)
        command = ["apt-get", *self._options, *words]
        with self._locked(fcntl.LOCK_SH):
            if subprocess.run(command, cwd=into, capture_output=True).returncode == 0:
                return
        with self._locked(fcntl.LOCK_EX):
            say("reading Debian's package lists again ...")  # a newer version may have replaced the known one
            run(["apt-get", *self._options, "update"])
        with self._locked(fcntl.LOCK_SH):
            run(command, cwd=into)

    def package(self, name: str) -> pathlib.Path:
        """Download a binary package; returns the .deb file."""
        into = self.folder / "deb"
        if not list(into.glob(f"{name}_*.deb")):
            say(f"downloading {name} ...")
            self._get(["download", name], into)
        return max(into.glob(f"{name}_*.deb"), key=lambda path: path.stat().st_mtime)

    def source(self, name: str, into: pathlib.Path) -> None:
        """Download a source package and unpack it, Debian's patches applied, as the folder `into`."""
        files = self.folder / "source" / name
        if not list(files.glob("*.dsc")):
            say(f"downloading the source of {name} ...")
            self._get(["source", "--download-only", name], files)
        dsc = max(files.glob("*.dsc"), key=lambda path: path.stat().st_mtime)
        run(["rm", "-rf", into])
        into.parent.mkdir(parents=True, exist_ok=True)
        run(["dpkg-source", "--no-check", "-x", dsc, into])
