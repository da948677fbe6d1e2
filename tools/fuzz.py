#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""make test-long T=fuzz: fuzz the parsers of data from outside. fuzz.py [-seconds N] [TARGET...]

The targets are tests/fuzz/<target>.c, built by clang with libFuzzer and sanitizers; `rtps` is Cyclone DDS. New inputs
are kept in output/fuzz/<target>, an input that breaks a target in output/fuzz/<target>-crash-...; the exit status is
then 1.
"""
import argparse
import os
import pathlib
import subprocess
from parts import defects
from parts.common import OUTPUT, TOP, Failed, fingerprint, finish, run, say, step
from parts.image import cyclonedds_fuzzed, native

FUZZ = OUTPUT / "fuzz"
VIDEO = TOP / "package/ddxvideo"
LOG = TOP / "package/ddxlog"
FORM = TOP / "package/ddx/form"
CORE = [f"stream/core/{path.name}" for path in sorted((VIDEO / "stream/core").glob("*.c"))]
SAP = [*CORE, "stream/network.c", "stream/sdp.c"]
Y4M = [f"common/{name}.c" for name in ("picture_convert", "video_item", "video_layout", "y4m_parse", "y4m_read")]
MP4 = [f"coded/{name}.c" for name in ("mp4_read", "mp4_write", "stamp")] + [
    f"common/{name}.c" for name in ("video_item", "video_layout")]
MCAP = [f"mcap/{name}.c" for name in ("bytes", "read", "reader")] + [
    str(TOP / f"package/ddx/{name}.c") for name in ("form/form", "form/schema", "lib/type_parse")]
PANEL = TOP / "package/ddxpanel"
REQUEST = ["common/message.c", "common/secret.c", "root/order.c",
           *(f"web/{name}.c" for name in ("download", "guard", "picture", "scgi"))]
CATALOG = TOP / "package/ddxcatalog"
NETWORK = [CATALOG / f"network/{name}.c" for name in ("participant", "records", "stamps", "value")] + [
    CATALOG / f"wire/{name}.c" for name in ("bucket", "description", "name")]
UPDATE = TOP / "package/ddxupdate"
UPDATED = [f"{name}.c" for name in ("block", "fat", "manifest", "place", "signature", "ustar")]
# Sources of each target, below a package, and libraries.
TARGETS: dict[str, tuple[pathlib.Path, list[str], list[str]]] = {
    "mcap": (LOG, MCAP, ["-lddx", "-llz4"]), "mp4": (VIDEO, MP4, ["-lddx"]), "panel": (PANEL, REQUEST, []),
    "repair": (VIDEO, CORE, ["-lm"]), "report": (VIDEO, CORE, ["-lm"]), "rtp": (VIDEO, CORE, ["-lm"]),
    "sap": (VIDEO, SAP, ["-lavutil", "-lm"]), "update": (UPDATE, UPDATED, ["-lsodium"]),
    "y4m": (VIDEO, Y4M, ["-lddx", "-lswscale", "-lavutil"])}
FLAGS = ["-std=gnu11", "-g", "-O1", "-Wall", "-Wextra", "-Werror", "-fsanitize=fuzzer,address,undefined",
         "-fno-sanitize-recover=all", "-D_GNU_SOURCE", "-DDDXVIDEO_UNDECLARED"]
NEEDS = ("llvm-symbolizer",)  # clang's sanitizers start it, for the names of functions
LONGEST = 8192  # bytes of an input
FOREIGN = "rtps"  # fuzzes Cyclone DDS, and the catalog's folder for it: tests/fuzz/rtps.c
ALL = sorted([*TARGETS, FOREIGN])


def compiled(source: pathlib.Path, words: list[str], folder: pathlib.Path) -> pathlib.Path:
    """The object in `folder`; ccache has it if another clone compiled the same."""
    folder.mkdir(exist_ok=True)
    target = folder / f"{source.parent.name}-{source.stem}.o"
    run(["ccache", "clang", *FLAGS, *words, "-c", source, "-o", target], env=native.CCACHE)
    return target


def link(program: pathlib.Path, sources: list[pathlib.Path], words: list[str],
         libraries: list[str | pathlib.Path]) -> None:
    """Compile with these words, and link."""
    objects = [compiled(source, words, program.with_suffix(".parts")) for source in sources]
    run(["clang", *FLAGS, *objects, "-o", program, *libraries])


def build(target: str, broken: bool) -> pathlib.Path:
    """Build a target; `broken`: from the copy of the sources with defects."""
    FUZZ.mkdir(parents=True, exist_ok=True)
    program = FUZZ / f"fuzz-{target}{'-broken' if broken else ''}"
    tree, switches = TOP, list[str]()
    if broken:
        tree, switches = defects.COPY, ["-include", str(defects.FOLDER / "broken.h")]
    package, names, needed = TARGETS[target]
    folders = [LOG / "mcap", FORM, VIDEO / "stream", VIDEO / "stream/core", VIDEO / "coded", VIDEO / "common",
               VIDEO / "include", TOP / "package/ddx/include", TOP / "package/ddx/lib", TOP / "package/ddx/program",
               *(PANEL / name for name in ("common", "root", "web")), UPDATE]
    libraries = OUTPUT / "desk/root" / native.LIBRARIES
    sources = [TOP / f"tests/fuzz/{target}.c", *(tree / (package / name).relative_to(TOP) for name in names)]

    def compile_it() -> None:
        link(program, sources, [*switches, *(f"-I{folder}" for folder in folders)],
             [f"-L{libraries}", f"-Wl,-rpath,{libraries}", *needed])

    key = fingerprint([*sources, *folders], *FLAGS, *switches)
    step(f"fuzz: {program.name}", program.with_suffix(".stamp"), key, compile_it)
    return program


def build_foreign() -> pathlib.Path:
    """One program: its library has the defect and a switch."""
    FUZZ.mkdir(parents=True, exist_ok=True)
    program, source, library = FUZZ / f"fuzz-{FOREIGN}", TOP / f"tests/fuzz/{FOREIGN}.c", cyclonedds_fuzzed.fuzzed()
    folders = [CATALOG / "network", CATALOG / "wire", TOP / "package/ddx/program"]

    def compile_it() -> None:
        link(program, [source, *NETWORK], [f"-isystem{library / 'include'}", *(f"-I{folder}" for folder in folders)],
             [library / "libddsc.a"])

    step(f"fuzz: {program.name}", program.with_suffix(".stamp"),
         fingerprint([source, *folders], library.name, *FLAGS), compile_it)
    return program


def seeds(target: str, few: bool = False) -> list[pathlib.Path]:
    """Folders with the first inputs; `few`: only ours."""
    theirs = [cyclonedds_fuzzed.fuzzed() / "seeds"] if target == FOREIGN and not few else []
    return [TOP / "tests/fuzz/corpus" / target, *theirs]


def fuzz(target: str, seconds: int, broken: str = "", corpus: pathlib.Path | None = None,
         seed: int = 0) -> tuple[bool, str]:
    """Run a target for this time, with a defect if `broken` names one. Whether nothing was found, and what libFuzzer
    says. A seed other than 0: the same inputs each time, as far as the time allows. The search for a defect begins
    with few inputs: among hundreds, those next to it are chosen too rarely."""
    program = build_foreign() if target == FOREIGN else build(target, bool(broken))
    found = FUZZ / target if corpus is None else corpus
    found.mkdir(parents=True, exist_ok=True)
    artifacts = FUZZ if corpus is None else corpus
    options = [f"-seed={seed}", f"-max_total_time={seconds}", f"-max_len={LONGEST}", "-timeout=20",
               "-rss_limit_mb=2000",
               "-print_final_stats=1", f"-artifact_prefix={artifacts}/{target}-"]
    done = subprocess.run([program, *options, found, *seeds(target, few=bool(broken))],
                          env={**os.environ, "DDX_BROKEN": broken}, stdin=subprocess.DEVNULL,
                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace")
    return done.returncode == 0, done.stdout


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("-seconds", type=int, default=300, help="for each target")
    parser.add_argument("targets", nargs="*", default=ALL)
    options = parser.parse_args()
    good = True
    native.build()
    for target in options.targets:
        if target not in ALL:
            raise Failed(f"no target {target}; there are {', '.join(ALL)}")
        say(f"fuzz: {target}: {options.seconds} s ...")
        fine, text = fuzz(target, options.seconds)
        lines = text.splitlines()
        say("\n".join(line for line in lines if line.startswith("stat::")) if fine else "\n".join(lines[-60:]))
        good &= fine
    return 0 if good else 1


if __name__ == "__main__":
    finish("fuzz", main)
