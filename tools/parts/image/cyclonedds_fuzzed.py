# SPDX-License-Identifier: GPL-2.0-or-later
"""Cyclone DDS for the fuzz target `rtps`: compiled with sanitizers, and with a defect that has a switch."""
import os
import pathlib
import shutil
import tempfile
import zipfile

from parts.common import TOP, fingerprint, run
from parts.image import cyclonedds, foreign

# Cyclone copies no bytes from a null pointer, calls functions by other types and reads unaligned words; compilers that
# build it allow all three.
FLAGS = ["-gline-tables-only", "-O1", "-fsanitize=fuzzer-no-link,address,undefined",
         "-fno-sanitize=alignment,function,nonnull-attribute", "-fno-sanitize-recover=all"]
# No packet of the target reaches the interface for programs or the values of writers (tests/fuzz/rtps.c): those files
# are compiled quickly, without sanitizers.
IDLE = """
file(GLOB idle "${CMAKE_CURRENT_SOURCE_DIR}/ddsc/src/*.c" "${CMAKE_CURRENT_SOURCE_DIR}/cdr/src/*.c")
set_source_files_properties(${idle} PROPERTIES COMPILE_OPTIONS "-fno-sanitize=all;-O0;-g0")
"""
PATCH, SWITCH = TOP / "tests/fuzz/rtps-broken.patch", TOP / "tests/defects/broken.h"
HEADERS = ["src/core/ddsc/include", "src/core/ddsc/src", "src/core/ddsi/include", "src/core/ddsi/src",
           "src/core/cdr/include", "src/ddsrt/include"]  # also those that are not installed
SEEDS = "fuzz/fuzz_handle_rtps_message/fuzz_handle_rtps_message_seed_corpus.zip"


def build(tree: pathlib.Path) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        source = cyclonedds.unpack(folder)
        run(["patch", "-p1", "--force", f"--input={PATCH}"], cwd=source)
        with (source / "src/core/CMakeLists.txt").open("a") as lists:
            lists.write(IDLE)
        run(["cmake", "-S", source, "-B", folder / "build", "-DCMAKE_C_COMPILER=clang",
             f"-DCMAKE_C_FLAGS={' '.join(FLAGS)} -I{SWITCH.parent}", *cyclonedds.options()])
        run(["cmake", "--build", folder / "build", "--target", "ddsc", f"-j{os.cpu_count()}"])
        tree.mkdir(parents=True)
        shutil.copy2(folder / "build/lib/libddsc.a", tree)
        for headers in (*(source / one for one in HEADERS), folder / "build/src/ddsrt/include",
                        folder / "build/src/core/include"):
            for header in headers.rglob("*.h"):
                to = tree / "include" / header.relative_to(headers)
                to.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(header, to)
        with zipfile.ZipFile(source / SEEDS) as seeds:
            seeds.extractall(tree / "seeds")


def fuzzed() -> pathlib.Path:
    """libddsc.a, its headers in `include`, and in `seeds` the inputs that its authors have. The network is needed the
    first time only."""
    key = fingerprint([pathlib.Path(__file__), PATCH, SWITCH, *cyclonedds.patches()], run(["clang", "--version"]),
                      cyclonedds.DIGEST, *cyclonedds.options())
    return foreign.kept("cyclonedds-fuzzed", key, build)
