# SPDX-License-Identifier: GPL-2.0-or-later
"""A long run that can be stopped and continued, with results of one build only.

The file has JSON lines. The first line identifies the run: a hash of image and programs, the commit and the options.
Each further line is a finished step. A run with another first line starts over: the results and the leftovers (logged
writes, a guest's disk) of the earlier run are removed.
"""
import contextlib
import fcntl
import json
import pathlib
import shutil
from collections.abc import Callable, Iterable, Iterator
from typing import Any

from parts.common import commit, fingerprint, say

Result = dict[str, Any]


def read(file: pathlib.Path) -> tuple[Result, dict[str, Any]]:
    """The first line, and the last result of each step. An incomplete line and a file of another kind are ignored."""
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
        first, *lines = [json.loads(line) for line in file.read_bytes().splitlines(keepends=True)
                         if line.endswith(b"\n")]
        return first["about"], {line["step"]: line["result"] for line in lines}
    return {}, {}


class Campaign:
    results: dict[str, Any]  # of finished steps, by name

    def __init__(self, file: pathlib.Path, made_of: Iterable[pathlib.Path], leftovers: Iterable[pathlib.Path] = (),
                 **options: object) -> None:
        """`made_of`: image and programs, files or folders. `leftovers`: files that steps leave for later ones."""
        self.file = file
        self.about: Result = {"commit": commit(), "made_of": fingerprint(made_of), "options": options}
        file.parent.mkdir(parents=True, exist_ok=True)
        with self._locked():
            before, self.results = read(file)
            if before == json.loads(json.dumps(self.about)):
                self._drop_cut_off()
                return
            if self.results:
                changed = [name for name in self.about if before.get(name) != self.about[name]]
                say(f"{file.stem}: starts over; {', '.join(changed) or 'the form of options'} changed")
            self.results = {}
            for path in leftovers:
                shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)
            file.write_text(json.dumps({"about": self.about}) + "\n")

    @contextlib.contextmanager
    def _locked(self) -> Iterator[None]:
        """Processes of one run of tests share a file."""
        with self.file.with_suffix(".lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            yield

    def _drop_cut_off(self) -> None:
        """Drop a last line that is incomplete, because the run was stopped while writing it."""
        whole = self.file.read_bytes()
        if not whole.endswith(b"\n"):
            self.file.write_bytes(whole[:whole.rfind(b"\n") + 1])

    def add(self, step: str, result: Any) -> None:
        """Keep the result of a finished step, in place of an earlier result."""
        self.results[step] = json.loads(json.dumps(result))
        with self._locked(), self.file.open("a") as file:
            file.write(json.dumps({"step": step, "result": result}) + "\n")

    def once(self, step: str, action: Callable[[], Any]) -> Any:
        """The result of a step, which runs now unless an earlier run has finished it."""
        if step not in self.results:
            self.add(step, action())
        return self.results[step]
