# SPDX-License-Identifier: GPL-2.0-or-later
"""Shared by all tools: paths, commands, progress lines, and steps that run only when needed."""
import argparse
import contextlib
import fcntl
import hashlib
import os
import pathlib
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, NoReturn, Self

TOP = pathlib.Path(__file__).resolve().parents[2]
OUTPUT = TOP / "output"
CACHE = OUTPUT / "cache"
# Outside of the tree: shared by all clones on this machine.
HOST_CACHE = pathlib.Path(os.environ.get("XDG_CACHE_HOME") or pathlib.Path.home() / ".cache") / "ddxvideo"
PROGRAMS = TOP / "tools/programs.txt"  # which package a program comes with
MEMORY = pathlib.Path("/dev/shm")
SBIN = {"PATH": os.environ.get("PATH", "/usr/bin:/bin") + ":/usr/sbin:/sbin"}  # not on every user's path

# s for a guest, QEMU or a tool on a busy machine; no result depends on it, it only limits a wait that would never end.
PATIENCE = 300.0

# Before a command: kills it when its parent exits.
MORTAL = ("setpriv", "--pdeathsig", "KILL")

Command = Sequence[str | os.PathLike[str]]


class Failed(Exception):
    """An error that is reported in one line."""
    status = 1


class BadInput(Failed):
    """The caller's words or files are wrong."""
    status = 2


class Closing:
    """A context manager: calls end() on leaving."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def end(self) -> None:
        raise NotImplementedError


def say(text: str) -> None:
    print(f"{text}\n", end="", flush=True)  # in one piece, also beside other threads


def run(command: Command, cwd: pathlib.Path | None = None, env: dict[str, str] | None = None,
        timeout: float | None = None) -> str:
    """Run a command, and return its output; if it fails, the output is printed."""
    try:
        done = subprocess.run(command, cwd=cwd, env={**os.environ, **SBIN, **(env or {})}, stdin=subprocess.DEVNULL,
                              stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace",
                              timeout=timeout)
    except subprocess.TimeoutExpired as error:
        raise Failed(f"not done after {error.timeout:.0f} s: {' '.join(map(str, command))}") from None
    if done.returncode != 0:
        sys.stdout.write("".join(done.stdout.splitlines(keepends=True)[-60:]))
        raise Failed(f"exit status {done.returncode}: {' '.join(map(str, command))}")
    return done.stdout


def output(command: Command, env: dict[str, str] | None = None) -> str:
    """The output of a command, in English; neither its exit status nor its errors matter."""
    return subprocess.run(command, env={**os.environ, **SBIN, "LC_ALL": "C", **(env or {})}, text=True, check=False,
                          stdin=subprocess.DEVNULL, capture_output=True, errors="replace").stdout


def wait_until(condition: Callable[[], bool], complaint: str, pause: float = 0.02, patience: float = PATIENCE) -> None:
    """Check the condition every `pause` seconds; fail with the complaint after `patience` seconds."""
    end = time.monotonic() + patience
    while not condition():
        if time.monotonic() > end:
            raise Failed(complaint)
        time.sleep(pause)


def commit() -> str:
    """The commit, with "-dirty" if the tree differs; empty outside git. DDX_COMMIT fixes the answer for a whole run, so
    that an edit during the run does not make another image."""
    if given := os.environ.get("DDX_COMMIT"):
        return given
    words = ["git", "describe", "--always", "--dirty", "--abbrev=12"]
    done = subprocess.run(words, cwd=TOP, capture_output=True, text=True, check=False)
    return done.stdout.strip()


def copy(source: pathlib.Path, target: pathlib.Path) -> None:
    """Copy a file that may have holes, such as a disk, without filling them."""
    run(["cp", "--reflink=auto", "--sparse=always", source, target])


@contextlib.contextmanager
def scratch(place: pathlib.Path | None = None) -> Iterator[pathlib.Path]:
    """A temporary folder, below `place` if it is given."""
    with tempfile.TemporaryDirectory(prefix="ddx-", dir=place) as name:
        yield pathlib.Path(name)


@contextlib.contextmanager
def alone(name: str, lock: pathlib.Path) -> Iterator[None]:
    """Hold a lock; if another process has it, print that and wait."""
    lock.parent.mkdir(parents=True, exist_ok=True)
    with lock.open("a+") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            file.seek(0)
            if (holder := file.read()) != str(os.getpid()):  # not another thread of this process
                say(f"{name}: waiting for process {holder or '?'}, which runs already ({lock})")
            fcntl.flock(file, fcntl.LOCK_EX)
        file.truncate(0)
        file.write(str(os.getpid()))
        file.flush()
        yield


def command_line(about: str | None, **defaults: Any) -> argparse.Namespace:
    """A tool's command line: one option for each default, of its type; False makes a switch. `about` is for -help."""
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, default in defaults.items():
        kind: dict[str, Any] = {"action": "store_true"} if default is False else {"type": type(default)}
        parser.add_argument(f"-{name.replace('_', '-')}", default=default, **kind)
    return parser.parse_args()


def packages_of(program: str) -> str:
    """The advice for a program that is not installed."""
    known = dict(line.split() for line in entries(PROGRAMS))
    name = pathlib.Path(program).name
    where = f"apt install {known[name]}" if name in known else "no Debian package of it is known here"
    return f"the program {name} is not installed: {where}"


def check_owner() -> None:
    """Fail if another user made the output folder, such as root with `sudo make`."""
    for folder in (TOP if not OUTPUT.exists() else OUTPUT, *OUTPUT.glob("*")):
        if folder.is_dir() and not os.access(folder, os.W_OK):
            raise Failed(_belongs(folder))


def _belongs(path: pathlib.Path) -> str:
    return f"{path} belongs to another user, perhaps after a `sudo make`: sudo chown -R $(id -un) {TOP}"


def finish(name: str, main: Callable[[], int]) -> NoReturn:
    """Run a tool's main() and exit with its status; a failure prints one line and gives status 1, bad input 2."""
    try:
        check_owner()
        sys.exit(main())
    except Failed as error:
        say(f"{name}: {error}")
        sys.exit(error.status)
    except KeyboardInterrupt:
        sys.exit(130)
    except FileNotFoundError as error:
        if not error.filename or "/" in str(error.filename):
            raise
        say(f"{name}: {packages_of(str(error.filename))}")  # subprocess reports the program that it did not find
        sys.exit(1)
    except PermissionError as error:
        if not error.filename or not pathlib.Path(error.filename).is_relative_to(TOP):
            raise
        say(f"{name}: {_belongs(pathlib.Path(error.filename))}")
        sys.exit(1)


def fingerprint(paths: Iterable[pathlib.Path], *words: str) -> str:
    """A hash over files (folders: everything below) and words, independent of times and of the clone's place."""
    digest = hashlib.sha256("\0".join(words).encode())
    for path in paths:
        below = path.rglob("*") if path.is_dir() else [path]
        for file in sorted(p for p in below if p.is_symlink() or p.is_file()):
            name = file.relative_to(TOP) if file.is_relative_to(TOP) else file
            digest.update(f"\0{name}\0{file.lstat().st_mode:o}\0".encode())
            if file.is_symlink():
                digest.update(os.readlink(file).encode())
                continue
            with file.open("rb") as content:  # a disk image does not fit into memory
                while block := content.read(1 << 20):
                    digest.update(block)
    return digest.hexdigest()


def step(title: str, stamp: pathlib.Path, key: str, action: Callable[[], object]) -> bool:
    """Do the action unless the stamp has the same key; returns whether the action was done."""
    if stamp.exists() and stamp.read_text() == key:
        return False
    stamp.parent.mkdir(parents=True, exist_ok=True)
    stamp.unlink(missing_ok=True)
    begin = time.monotonic()
    say(f"{title} ...")
    action()
    say(f"{title}: {time.monotonic() - begin:.1f} s")
    stamp.write_text(key)
    return True


def entries(path: pathlib.Path) -> list[str]:
    """The lines of a list file, without comments and empty lines."""
    lines = (line.split("#", 1)[0].strip() for line in path.read_text().splitlines())
    return [line for line in lines if line]
