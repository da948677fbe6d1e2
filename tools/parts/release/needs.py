# SPDX-License-Identifier: GPL-2.0-or-later
"""The Debian packages that a target of the Makefile needs, and those that it installs.

A tool needs the programs that it starts and the Python modules that it imports, in all modules that it reaches by
imports. A word of tools/programs.txt counts as a started program if it is the first one of a list or tuple (after
`nice` and the like any one), if a shell script that the tool names has it, or if it is in a module's NEEDS. Packages
that come with each Debian, or by a dependency, are there.
"""
import ast
import dataclasses
import functools
import importlib.util
import pathlib
import re
import subprocess
import sys
from collections.abc import Iterable, Iterator

from parts.common import PROGRAMS, TOP, entries, output

TOOLS = TOP / "tools"
LIST = TOOLS / "debian-packages.txt"
ROOTFS = TOOLS / "parts/image/rootfs.py"
# Modules that a target reaches by imports, but does not use: tools/parts/image/native.py, for_run().
UNUSED = {"run": {TOOLS / "parts/image/cyclonedds.py"}}
TESTS = [path for path in sorted((TOP / "tests").rglob("*.py")) if not path.stem.endswith("_long")]
BARE = ["git", "make", "sudo", "ca-certificates"]  # on a new machine, beside Debian's smallest
WRAPPERS = frozenset("ccache env nice setpriv sudo timeout unshare".split())
STARTERS = {"run", "output", "Popen", "check_output", "check_call", "call"}
WORD = re.compile(r"[A-Za-z][\w.+-]*")


@dataclasses.dataclass(frozen=True)
class Target:
    name: str  # as in `make NAME`
    parts: frozenset[str]  # of the package list, that it installs
    tools: frozenset[pathlib.Path]


def parts() -> dict[str, set[str]]:
    """The package list: packages by the part's name, which is empty for the first one."""
    result: dict[str, set[str]] = {"": set()}
    name = ""
    for line in LIST.read_text().splitlines():
        if line.startswith("## "):
            name = line[3:].strip()
            result[name] = set()
        elif line and not line.startswith("#"):
            result[name].add(line.split()[0])
    return result


def calls(makefile: str) -> list[str]:
    """The arguments of `make` that differ in what they install or start: each target, and each campaign."""
    names = re.findall(r"^([a-z][a-z-]*):[^=\n]*#", makefile, re.M)
    campaigns = re.search(r"^CAMPAIGNS = (.*)$", makefile, re.M)
    return [*names, *(f"test-long T={name}" for name in (campaigns[1].split() if campaigns else []))]


def targets() -> list[Target]:
    """The packages and programs that each target would install and start, by make's own dry run."""
    found = []
    for words in calls((TOP / "Makefile").read_text()):
        lines = subprocess.run(["make", "-n", *words.split()], cwd=TOP, capture_output=True, text=True, check=True,
                               env={"PATH": "/usr/bin:/bin"}).stdout.splitlines()
        setups = [line.split()[1:] for line in lines if line.startswith("tools/setup")]
        if words == "run":
            setups.append(["run"])  # which the tool installs itself: for_run() of tools/build.py
        tools = {TOP / name for line in lines for name in re.findall(r"tools/\w+\.py", line)}
        tools |= {TOP / f"bench/{name}.py" for line in lines for name in re.findall(r"tools/bench (\w+)", line)}
        found.append(Target(words, frozenset({"", *(part for parts in setups for part in parts)}), frozenset(tools)))
    return found


@functools.cache
def nodes(path: pathlib.Path) -> list[ast.AST]:
    """All of a module's syntax."""
    return list(ast.walk(ast.parse(path.read_text())))


def imports(path: pathlib.Path) -> Iterator[str]:
    """The modules that a file names, with dots; of `from a import b` also a.b."""
    for node in nodes(path):
        if isinstance(node, ast.Import):
            yield from (name.name for name in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module
            yield from (f"{node.module}.{name.name}" for name in node.names)


@functools.cache
def reached(tool: pathlib.Path) -> set[pathlib.Path]:
    """The tool and the modules of tools/ and bench/ that it imports, directly or not."""
    found, wanted = set(), [tool]
    while wanted:
        path = wanted.pop()
        if path in found:
            continue
        found.add(path)
        wanted += [file for name in imports(path) for top in (TOOLS, TOP)
                   if (file := top / (name.replace(".", "/") + ".py")).is_file()]
    return found


@functools.cache
def foreign_modules(path: pathlib.Path) -> set[str]:
    """The imported modules that are neither ours nor Python's own."""
    tops = {name.split(".")[0] for name in imports(path)}
    ours = {"parts", "bench", "ddx", "ddxvideo", "lib", "tests"} | {one.stem for one in TOOLS.glob("*.py")}
    return {name for name in tops if name not in sys.stdlib_module_names and name not in ours}


def _words(node: ast.List | ast.Tuple) -> list[str]:
    """The words of a list or tuple, without spliced ones such as *NICE and without expressions."""
    return [item.value for item in node.elts if isinstance(item, ast.Constant) and isinstance(item.value, str)]


@functools.cache
def command_words(path: pathlib.Path) -> set[str]:
    """The words that may be programs."""
    found: set[str] = set()
    for node in nodes(path):
        if isinstance(node, (ast.List, ast.Tuple)) and (words := _words(node)):
            first = next((item for item in node.elts if not isinstance(item, ast.Starred)), None)
            if isinstance(first, ast.Constant):
                found |= set(words) if words[0] in WRAPPERS else {words[0]}
        elif isinstance(node, ast.Assign) and isinstance(node.value, ast.Tuple) and any(
                isinstance(target, ast.Name) and target.id == "NEEDS" for target in node.targets):
            found |= set(_words(node.value))
    return found


def scripts(path: pathlib.Path) -> Iterator[tuple[str, str]]:
    """Shell scripts that a module has as text or names as files: their text, and where it is."""
    for node in nodes(path):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            if re.fullmatch(r"(tools|board/common)/[\w.-]+", node.value) and (TOP / node.value).is_file():
                text = (TOP / node.value).read_text(errors="replace")
                if text.startswith("#!/bin/sh"):
                    yield text, node.value
        if isinstance(node, (ast.List, ast.Tuple)) and len(node.elts) > 2:
            words = [item.value if isinstance(item, ast.Constant) else None for item in node.elts]
            if words[0] == "sh" and isinstance(words[2], str):
                yield words[2], str(path.relative_to(TOP))


@functools.cache
def known() -> dict[str, str]:
    """tools/programs.txt: the package of each program."""
    return dict(line.split() for line in entries(PROGRAMS))


@functools.cache
def started(path: pathlib.Path) -> set[tuple[str, str]]:
    """The programs of tools/programs.txt that a module starts, each with the file that names it."""
    name, programs = str(path.relative_to(TOP)), known()
    found = {(word, name) for word in command_words(path) if word in programs}
    for text, where in scripts(path):
        code = "\n".join(line.split(" #")[0] for line in text.splitlines() if not line.lstrip().startswith("#"))
        found |= {(word, where) for word in WORD.findall(code) if word in programs}
    return found


@functools.cache
def unknown(path: pathlib.Path) -> set[str]:
    """The programs that a module passes to run() and so on, but that neither a bare Debian nor programs.txt has."""
    words = {first.value for node in nodes(path)
             if isinstance(node, ast.Call) and node.args and isinstance(node.args[0], (ast.List, ast.Tuple))
             and getattr(node.func, "attr", getattr(node.func, "id", "")) in STARTERS
             and (first := node.args[0].elts[0] if node.args[0].elts else None) is not None
             and isinstance(first, ast.Constant) and isinstance(first.value, str) and WORD.fullmatch(first.value)}
    there = installed().bare
    return {word for word, package in owners(words - set(known())).items() if package not in there}


FOLDERS = ("/usr/bin", "/bin", "/usr/sbin", "/sbin")
_owners: dict[str, str] = {}


def _places(word: str) -> set[str]:
    """Where dpkg may know a program or file: with and without /usr, and what an alternative's link leads to."""
    there = [word] if word.startswith("/") else [f"{folder}/{word}" for folder in FOLDERS]
    both = {*there, *(str(pathlib.Path(path).resolve()) for path in there if pathlib.Path(path).exists())}
    return both | {path.removeprefix("/usr") for path in both} | {f"/usr{path.removeprefix('/usr')}" for path in both}


def owners(words: Iterable[str]) -> dict[str, str]:
    """The installed package of each program or file; empty for those that are not installed."""
    wanted = [word for word in set(words) if word not in _owners]
    if wanted:
        _owners.update(dict.fromkeys(wanted, ""))
        paths = {path: word for word in wanted for path in _places(word)}
        for line in output(["dpkg-query", "-S", *paths]).splitlines():
            packages, _, path = line.rpartition(": ")
            if path in paths and not line.startswith("diversion "):
                _owners[paths[path]] = packages.split(",")[0].split(":")[0]
    return {word: _owners[word] for word in words}


class Installed:
    """The packages of this machine: what depends on what."""

    def __init__(self) -> None:
        shown = output(["dpkg-query", "-W", "-f",
                        "${Package}\t${Essential}\t${Priority}\t${Provides}\t${Pre-Depends}, ${Depends}\n"])
        self.needs: dict[str, list[list[str]]] = {}
        self.provided: dict[str, list[str]] = {}
        first = list(BARE)
        for line in shown.splitlines():
            name, essential, priority, provides, depends = line.split("\t")
            if essential == "yes" or priority == "required" or name == "apt":
                first.append(name)
            for word in _names(provides):
                self.provided.setdefault(word, []).append(name)
            self.needs[name] = [[_name(one) for one in alternatives.split("|")]
                                for alternatives in depends.split(",") if alternatives.strip()]
        self.bare = self.closure(first)

    def closure(self, packages: Iterable[str]) -> set[str]:
        """The packages and all that come with them. Of alternatives the first one comes, which apt chooses."""
        found: set[str] = set()
        wanted = list(packages)
        while wanted:
            name = wanted.pop()
            if name in found:
                continue
            found.add(name)
            for alternatives in self.needs.get(name, []):
                wanted += [alternatives[0], *self.provided.get(alternatives[0], [])[:1]]
        return found


@functools.cache
def installed() -> Installed:
    return Installed()


def _name(word: str) -> str:
    return re.split(r"[\s:(]", word.strip())[0]


def _names(words: str) -> list[str]:
    return [_name(word) for word in words.split(",") if word.strip()]


def package_of(module: str) -> str:
    """The package of a Python module, by its files or, if it is not installed, by Debian's usual name."""
    spec = importlib.util.find_spec(module)
    place = spec.origin if spec and spec.origin else ""
    return owners([place])[place] if place else f"python3-{module.lower().replace('_', '-')}"


def complaints(have: dict[str, set[str]]) -> Iterator[str]:
    """Errors in a package list, and in programs.txt, for the targets of the Makefile."""
    there, programs = installed(), known()
    for program, package in sorted(programs.items()):
        if (found := owners(programs)[program]) and found not in there.closure([package]):
            yield f"tools/programs.txt: {program} comes with {found}, not with {package}"
    seen: set[pathlib.Path] = set()
    for target in targets():
        listed = set().union(*(have.get(part, set()) for part in target.parts))
        available = there.bare | there.closure(listed)
        roots = {*target.tools, *(TESTS if TOOLS / "gate.py" in target.tools else [])}
        for path in sorted({path for root in roots for path in reached(root)} - UNUSED.get(target.name, set())):
            wanted = [(f"starts {program}", programs[program], where) for program, where in sorted(started(path))]
            wanted += [(f"imports {module}", package_of(module), str(path.relative_to(TOP)))
                       for module in sorted(foreign_modules(path))]
            if path == ROOTFS:
                wanted += [(f"copies {file}", package, "board/dev/host-programs.txt")
                           for file, package in owners(entries(TOP / "board/dev/host-programs.txt")).items()]
            for what, package, where in wanted:
                if package not in available:
                    yield (f"make {target.name}: {where} {what}: {package} is in no part of "
                           f"tools/debian-packages.txt that the target installs")
            if path not in seen:
                seen.add(path)
                for word in sorted(unknown(path)):
                    yield f"{path.relative_to(TOP)} starts {word}: tools/programs.txt does not say which package has it"
