# SPDX-License-Identifier: GPL-2.0-or-later
"""FFmpeg and x264 for the development image, from Debian's source packages, with the parts that the product has.

The same versions as Debian's libraries, which the programs are built with, so these take their place in the image:
Debian's own would bring 130 MB of libraries along.
"""
import os
import pathlib

from archive import Archive
from common import CACHE, OUTPUT, TOP, fingerprint, run, step

CONFIG = TOP / "board/common/ffmpeg.config"


def options() -> list[str]:
    """The product's choice of parts: lines that configure understands."""
    lines = (line.split("#", 1)[0].split() for line in CONFIG.read_text().splitlines())
    return [word for words in lines for word in words]


def ffmpeg() -> pathlib.Path:
    """An install tree: usr/lib/*.so."""
    out = OUTPUT / "dev/ffmpeg"
    sources = {name: CACHE / name for name in ("x264", "ffmpeg")}
    jobs = f"-j{os.cpu_count()}"

    def unpack() -> None:
        for name, folder in sources.items():
            Archive().source(name, folder)

    def build() -> None:
        run(["rm", "-rf", out])
        run(["./configure", f"--prefix={out}/usr", "--enable-shared", "--disable-cli", "--disable-opencl",
             "--bit-depth=8", "--chroma-format=420"], cwd=sources["x264"])
        run(["make", jobs, "install-lib-shared"], cwd=sources["x264"])
        run(["./configure", f"--prefix={out}/usr", "--enable-shared", "--disable-static", *options()],
            cwd=sources["ffmpeg"], env={"PKG_CONFIG_PATH": f"{out}/usr/lib/pkgconfig"})
        run(["make", jobs, "install-libs"], cwd=sources["ffmpeg"])

    step("FFmpeg: source", CACHE / "ffmpeg.stamp", "bookworm", unpack)
    step("FFmpeg: build", OUTPUT / "dev/ffmpeg.stamp", fingerprint([CONFIG, pathlib.Path(__file__)]), build)
    return out
