# SPDX-License-Identifier: GPL-2.0-or-later
"""Cyclone DDS for the fuzz target `rtps`: compiled with sanitizers, and with defects that have a switch."""
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
# Code that packets of the target do not reach is compiled quickly, without sanitizers: most of the interface for
# programs, and transports and settings that it does not have.
REACHED = ("builtin", "read", "reader", "rhc", "rhc_default", "serdata_builtintopic", "serdata_default",
           "sertype_default", "whc")
OTHERS = ("config", "debmon", "eth", "nwinterfaces", "pcap", "portmapping", "raweth", "tcp", "threadmon", "vnet")
IDLE = f"""
file(GLOB idle "${{CMAKE_CURRENT_SOURCE_DIR}}/ddsc/src/*.c")
list(FILTER idle EXCLUDE REGEX "/dds_({'|'.join(REACHED)})[.]c$")
file(GLOB others "${{CMAKE_CURRENT_SOURCE_DIR}}/ddsi/src/*.c")
list(FILTER others INCLUDE REGEX "/ddsi_({'|'.join(OTHERS)})[.]c$")
set_source_files_properties(${{idle}} ${{others}} PROPERTIES COMPILE_OPTIONS "-fno-sanitize=all;-O0;-g0")
"""
PATCHES = [TOP / "tests/fuzz/rtps-broken.patch", TOP / "tests/fuzz/rtps-often.patch"]
SWITCH = TOP / "tests/defects/broken.h"
HEADERS = ["src/core/ddsc/include", "src/core/ddsc/src", "src/core/ddsi/include", "src/core/ddsi/src",
           "src/core/cdr/include", "src/ddsrt/include"]  # also those that are not installed
SEEDS = "fuzz/fuzz_handle_rtps_message/fuzz_handle_rtps_message_seed_corpus.zip"


def build(tree: pathlib.Path) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        source = cyclonedds.unpack(folder)
        for patch in PATCHES:
            run(["patch", "-p1", "--force", f"--input={patch}"], cwd=source)
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
    key = fingerprint([pathlib.Path(__file__), *PATCHES, SWITCH, *cyclonedds.patches()], run(["clang", "--version"]),
                      cyclonedds.DIGEST, *cyclonedds.options())
    return foreign.kept("cyclonedds-fuzzed", key, build)
