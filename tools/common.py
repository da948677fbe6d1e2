# SPDX-License-Identifier: GPL-2.0-or-later
"""What every tool shares: where things are, running commands, progress lines, steps that are done only when needed."""
import hashlib
import os
import pathlib
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from typing import NoReturn

TOP = pathlib.Path(__file__).resolve().parent.parent
OUTPUT = TOP / "output"
CACHE = OUTPUT / "cache"
SBIN = {"PATH": os.environ.get("PATH", "/usr/bin:/bin") + ":/usr/sbin:/sbin"}  # not on everybody's path

Command = Sequence[str | os.PathLike[str]]


class Failed(Exception):
    """Something went wrong that is best told in one line."""


def say(text: str) -> None:
    print(text, flush=True)


def run(command: Command, cwd: pathlib.Path | None = None, env: dict[str, str] | None = None) -> str:
    """Run a command quietly; what it printed is the result, or shown when it failed."""
    done = subprocess.run(command, cwd=cwd, env={**os.environ, **SBIN, **(env or {})}, stdin=subprocess.DEVNULL,
                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace")
    if done.returncode != 0:
        sys.stdout.write("".join(done.stdout.splitlines(keepends=True)[-60:]))
        raise Failed(f"exit status {done.returncode}: {' '.join(map(str, command))}")
    return done.stdout


def finish(name: str, main: Callable[[], int]) -> NoReturn:
    """Run a tool's main() and end with its status; what failed is one line and status 1."""
    try:
        sys.exit(main())
    except Failed as error:
        say(f"{name}: {error}")
        sys.exit(1)


def fingerprint(paths: Iterable[pathlib.Path], *words: str) -> str:
    """A hash over files (folders: everything below) and words. Times do not count, contents do."""
    digest = hashlib.sha256("\0".join(words).encode())
    for path in paths:
        below = path.rglob("*") if path.is_dir() else [path]
        for file in sorted(p for p in below if p.is_symlink() or p.is_file()):
            digest.update(f"\0{file}\0{file.lstat().st_mode:o}\0".encode())
            digest.update(os.readlink(file).encode() if file.is_symlink() else file.read_bytes())
    return digest.hexdigest()


def step(title: str, stamp: pathlib.Path, key: str, action: Callable[[], None]) -> bool:
    """Do the action unless the stamp says that it was done with the same key. True when it was done now."""
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
