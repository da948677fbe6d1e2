# SPDX-License-Identifier: GPL-2.0-or-later
"""make bench: the stereo matcher beside OpenCV's, on pairs with known disparities. See docs/bench.md.

tools/bench stereo [-rounds N] [-short]: CPU time of one thread. A round runs each matcher on each pair, in a random
order; `ratio` is the median over the rounds of ours / SGBM. -short: one round of the smallest pair, for the gate.
"""
import ctypes
import importlib
import random
import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy
from numpy.typing import NDArray

from bench.measure import save
from parts.common import OUTPUT, TOP, Failed, command_line, finish, run, say
from parts.media import stereo_pairs
from parts.media.stereo_pairs import Grey, Map, Pair

STEREO = TOP / "package/ddxvideo/stereo"
KINDS = ("mmx", "sse2", "avx2")
PAIRS = {"motorcycle 368x248": (stereo_pairs.motorcycle, 2, 48), "motorcycle 741x500": (stereo_pairs.motorcycle, 1, 80),
         "aloe 424x368": (stereo_pairs.aloe, 3, 80), "aloe 640x552": (stereo_pairs.aloe, 2, 112)}
SIZES = {"CIF 352x288": (352, 288, 64), "SVS 320x240": (320, 240, 32)}  # pictures of noise, for the time alone

Matcher = Callable[[Grey, Grey], NDArray[Any]]


class Settings(ctypes.Structure):
    """struct matcher_settings of matcher.h."""
    _fields_ = [(name, ctypes.c_int) for name in ("width", "height", "disparities", "uniqueness", "agreement",
                                                  "speckle")] + [("variant", ctypes.c_char_p)]


def library() -> ctypes.CDLL:
    """The matcher, compiled with the options of stereo/meson.build and of debugoptimized."""
    out = OUTPUT / "bench/stereo"
    out.mkdir(parents=True, exist_ok=True)
    gcc = ["gcc", "-O2", "-g", "-fPIC", "-std=gnu11", f"-I{STEREO}"]
    for kind in KINDS:
        run([*gcc, f"-m{kind}", "-c", STEREO / f"kernel_{kind}.c", "-o", out / f"{kind}.o"])
    files = [STEREO / f"{name}.c" for name in ("kernel_scalar", "matcher")]
    run([*gcc, "-shared", *files, *(out / f"{kind}.o" for kind in KINDS), "-o", out / "matcher.so"])
    found = ctypes.CDLL(str(out / "matcher.so"))
    found.matcher_new.restype = found.matcher_variant.restype = ctypes.c_void_p
    return found


def ours(code: ctypes.CDLL, width: int, height: int, disparities: int, variant: str | None = None) -> Matcher | None:
    """None if the processor does not support the variant."""
    settings = Settings(width, height, disparities, 5, 1, 50, variant.encode() if variant else None)
    matcher = code.matcher_new(ctypes.byref(settings))
    if not matcher:
        return None
    result = numpy.zeros((height, width), numpy.uint16)

    def match(left: Grey, right: Grey) -> NDArray[Any]:
        code.matcher_run(ctypes.c_void_p(matcher), left.ctypes.data_as(ctypes.c_void_p), ctypes.c_long(width),
                         right.ctypes.data_as(ctypes.c_void_p), ctypes.c_long(width),
                         result.ctypes.data_as(ctypes.c_void_p))
        return result

    return match


def sgbm(cv2: Any, disparities: int) -> Matcher:
    made = cv2.StereoSGBM_create(0, disparities, 3, 8 * 9, 32 * 9, 1, 63, 10, 100, 2, cv2.STEREO_SGBM_MODE_SGBM_3WAY)
    return lambda left, right: numpy.asarray(made.compute(left, right))


def block(cv2: Any, disparities: int) -> Matcher:
    made = cv2.StereoBM_create(disparities, 15)
    return lambda left, right: numpy.asarray(made.compute(left, right))


def timed(matcher: Matcher, left: Grey, right: Grey) -> tuple[float, NDArray[Any]]:
    begin = time.process_time()
    found = matcher(left, right)
    return (time.process_time() - begin) * 1000, found


def compare(name: str, matchers: dict[str, Matcher], pair: Pair, rounds: int, judge: bool) -> dict[str, Any]:
    """Time of each matcher in ms and its ratio to SGBM's; if `judge`, also the share of wrong or missing pixels."""
    spent: dict[str, list[float]] = {one: [] for one in matchers}
    wrong = {}
    for _ in range(rounds):
        for one in random.sample(list(matchers), len(matchers)):
            took, found = timed(matchers[one], pair.left, pair.right)
            spent[one].append(took)
            if judge and one not in wrong:
                map: Map = found.astype(numpy.float32) / 16
                wrong[one] = round(100 * pair.wrong(map), 1)
    figures: dict[str, Any] = {}
    for one, times in spent.items():
        figures[one] = {"ms": round(statistics.median(times), 2)}
        if "SGBM" in spent:
            ratio = statistics.median(a / b for a, b in zip(times, spent["SGBM"]))
            figures[one]["ratio"] = round(ratio, 2)
        if judge:
            figures[one]["wrong_percent"] = wrong[one]
        say(f"bench: stereo: {name}, {pair.disparities} disparities, {one}: " +
            ", ".join(f"{value} {what}" for what, value in figures[one].items()))
    return figures


def main() -> int:
    arguments = command_line(__doc__, rounds=15, short=False)
    try:
        cv2: Any = importlib.import_module("cv2")
    except ImportError:
        raise Failed("needs Debian's python3-opencv; tools/setup bench installs it") from None
    cv2.setNumThreads(1)
    code, figures = library(), {}
    rounds = 1 if arguments.short else arguments.rounds
    for name, (make, factor, disparities) in list(PAIRS.items())[:1 if arguments.short else None]:
        pair = make(factor, disparities)
        height, width = pair.left.shape
        mine = ours(code, width, height, disparities)
        assert mine
        matchers = {"ours": mine, "SGBM": sgbm(cv2, disparities), "BM": block(cv2, disparities)}
        figures[name] = compare(name, matchers, pair, rounds, True)
    if arguments.short:
        return 0
    for name, (width, height, disparities) in SIZES.items():
        noise = numpy.random.default_rng(1).integers(0, 256, (height, width + 9), numpy.uint8)
        unknown = numpy.zeros((height, width), numpy.float32)
        pair = Pair(noise[:, :width].copy(), noise[:, 9:].copy(), unknown, disparities)
        variants = {kind: ours(code, width, height, disparities, kind) for kind in ("scalar", *KINDS)}
        figures[name] = compare(name, {kind: one for kind, one in variants.items() if one}, pair, rounds, False)
    save("stereo", figures)
    return 0


if __name__ == "__main__":
    finish("bench", main)
