# SPDX-License-Identifier: GPL-2.0-or-later
"""make bench: what compressed recordings cost. See docs/bench.md.

tools/bench mp4 [-seconds N] [-lasting N] [-parts WORD,...] [-short]: the recorder's processor time beside x264 alone,
at CIF and 1080p, with noise; bytes on the disk; memory beside a Y4M recorder; 1080p for `lasting` seconds, with nothing
else that runs, and beside two compilers; the seconds of a pre-roll; the time from a key to a picture of ddxvideoview,
forward and back in a 1080p file, and for jumps of a minute in one of 11 minutes; Chromium's seeks in a file of 11
minutes. Writes output/bench/mp4.json. -parts: only those whose name has one of the words. -short: a few seconds,
without Chromium; writes no file.
"""
import argparse
import json
import os
import pathlib
import random
import re
import shutil
import subprocess
import time
from collections.abc import Callable
from typing import Any

import numpy

from bench import view
from bench.measure import save
from bench.player import Player
from bench.programs import Programs, cpu_seconds
from bench.record import HD, hd_clip
from parts.common import MEMORY, MORTAL, OUTPUT, Failed, command_line, finish, output, say, scratch, wait_until
from parts.image import native
from parts.media import clip as drawn

ALONE = OUTPUT / "desk/ddxvideo/tests/h264"
SIGMA = 2           # of the noise
QUALITY = "18"
WARM = 3            # s
MINUTES = 11        # of the file that Chromium seeks in
SEEKS = 50
PRE_ROLL = 30       # s, more than fits
STEPPED = 200       # frames of the file that the viewer steps through
LOOPED = 199        # frames of the clip in the file that it jumps in: no minute shows the grey of the one before
SEARCHED = 3        # s, in which it has found all frames of that file


def noisy(source: pathlib.Path, path: pathlib.Path, picture: int, frames: int) -> pathlib.Path:
    """The first frames of a clip, with Gaussian noise, as from a sensor."""
    chance = numpy.random.default_rng(1)
    with source.open("rb") as file, path.open("wb") as target:
        target.write(file.readline())
        for _ in range(frames):
            target.write(file.readline())
            plain = numpy.frombuffer(file.read(picture), numpy.uint8)
            noise = chance.normal(0, SIGMA, picture)
            target.write(numpy.clip(numpy.rint(plain + noise), 0, 255).astype(numpy.uint8).tobytes())
    return path


def memory(process: subprocess.Popen[bytes]) -> float:
    """MB of its own, at most so far."""
    status = pathlib.Path(f"/proc/{process.pid}/status").read_text()
    found = re.search(r"RssAnon:\s+(\d+) kB", status)
    return int(found[1]) / 1024 if found else 0.0


def urgent(process: subprocess.Popen[bytes]) -> subprocess.Popen[bytes]:
    """With the priority of the image's recorder, `realtime=10`, for which root is needed: beside other work, all of the
    frames are encoded, and none more coarsely."""
    if os.geteuid() == 0:
        os.sched_setscheduler(process.pid, os.SCHED_FIFO, os.sched_param(10))
    return process


def cost(folder: pathlib.Path, clip: pathlib.Path, seconds: int) -> dict[str, float]:
    """Two recorders, MP4 and Y4M, and x264 alone, at the same time."""
    folder.mkdir()
    with Programs(folder) as programs:
        coded = urgent(programs.start("ddxvideosave", "-output", "out.mp4", "-quality", QUALITY, "-instance", "coded"))
        plain = urgent(programs.start("ddxvideosave", "-output", "out.y4m", "-instance", "plain"))
        programs.start("ddxvideoload", str(clip), "-loop", "-readers", "2")
        alone = urgent(subprocess.Popen([*MORTAL, ALONE, clip, QUALITY]))
        programs.running.append(alone)
        wait_until(lambda: programs.count("coded", "out") > 0, "nothing is recorded")
        time.sleep(WARM)
        of = {"recorder": coded, "x264": alone, "y4m": plain}
        before, frames = {name: cpu_seconds(one) for name, one in of.items()}, programs.count("coded", "in")
        begin, size = time.monotonic(), (folder / "out.mp4").stat().st_size
        time.sleep(seconds)
        passed = time.monotonic() - begin
        spent = {name: cpu_seconds(one) - before[name] for name, one in of.items()}
        found = {"ratio": spent["recorder"] / spent["x264"], "percent": 100 * spent["recorder"] / passed,
                 "y4m_percent": 100 * spent["y4m"] / passed,
                 "ms_frame": 1000 * spent["recorder"] / (programs.count("coded", "in") - frames),
                 "mb_s": ((folder / "out.mp4").stat().st_size - size) / passed / 1e6,
                 "memory_mb": memory(coded), "y4m_memory_mb": memory(plain),
                 "lost": programs.lost("coded"), "y4m_lost": programs.lost("plain")}
    shutil.rmtree(folder)
    return {name: round(value, 2) for name, value in found.items()}


def program(path: pathlib.Path) -> pathlib.Path:
    """For a compiler: it needs some seconds."""
    path.write_text("".join(f"double f{n}(double *a, int n) {{ double s = {n}; for (int i = 0; i < n; i++) "
                            "for (int j = 0; j < i; j++) s += a[i] * a[j] / (s + j); return s; }\n"
                            for n in range(400)))
    return path


def lasting(folder: pathlib.Path, clip: pathlib.Path, seconds: int, compilers: int) -> dict[str, float]:
    """The image's recorder, with the priority that it has there, as have store and source."""
    (folder / "rec").mkdir(parents=True)
    source = program(folder / "program.c")
    with Programs(folder) as programs:
        urgent(programs.running[0])
        saver = urgent(programs.start("ddxvideosave", "-output", "rec", "-segment", "256", "-format", "h264",
                                      "-quality", QUALITY))
        wait_until(lambda: programs.answers("ddxvideosave"), "the recorder does not start")
        busy = [subprocess.Popen([*MORTAL, "sh", "-c", f"while :; do gcc -O2 -c {source} -o /dev/null; done"])
                for _ in range(compilers)]
        programs.running += busy
        urgent(programs.start("ddxvideoload", str(clip), "-loop", "-readers", "1"))
        wait_until(lambda: programs.count("ddxvideosave", "out") > 0, "nothing is recorded")
        begin, before = time.monotonic(), cpu_seconds(saver)
        first = programs.count("ddxvideosave", "in")
        time.sleep(seconds)
        spent, passed = cpu_seconds(saver) - before, time.monotonic() - begin
        frames = programs.count("ddxvideosave", "in") - first
        disk = json.loads(output([programs.bin / "ddxctl", "show", "ddxvideosave.disk", "--json"],
                                 programs.environment))["value"]
        found = {"seconds": round(passed), "percent": round(100 * spent / passed, 1), "frames": frames,
                 "ms_frame": round(1000 * spent / frames, 2), "memory_mb": round(memory(saver), 1),
                 "lost": programs.lost("ddxvideosave"), "coarse": disk["coarse"]}
    shutil.rmtree(folder)
    return found


def pre_roll(folder: pathlib.Path, clip: pathlib.Path, seconds: int, form: str) -> float:
    """Seconds that a stopped recorder keeps, with the usual queue."""
    (folder / "rec").mkdir(parents=True)
    with Programs(folder) as programs:
        programs.start("ddxvideosave", "-output", "rec", "-segment", "64", "-format", form, "-start", "paused")
        programs.start("ddxvideoload", str(clip), "-loop", "-readers", "1")
        wait_until(lambda: programs.count("ddxvideosave", "skipped") > 0, "no frame is skipped")
        for wanted in range(PRE_ROLL, 0, -1):  # Y4M: the recorder refuses what does not fit
            said = subprocess.run([programs.bin / "ddxctl", "set", "ddxvideosave", f"pre_roll={wanted}"],
                                  env=programs.environment, capture_output=True, check=False)
            if not said.returncode:
                break
        time.sleep(seconds)
        output([programs.bin / "ddxctl", "set", "ddxvideosave", "recording=1"], programs.environment)
        wait_until(lambda: programs.count("ddxvideosave", "in") > 0, "nothing is recorded")
        kept = programs.count("ddxvideosave", "in")
    shutil.rmtree(folder)
    return kept / drawn.RATE


def recorded(folder: pathlib.Path, clip: pathlib.Path, frames: int, quality: str) -> pathlib.Path:
    """An MP4 file of that many frames of the clip, by its times."""
    folder.mkdir()
    with Programs(folder) as programs:
        saver = programs.start("ddxvideosave", "-output", "out.mp4", "-quality", quality)
        wait_until(lambda: programs.answers("ddxvideosave"), "the recorder does not start")
        programs.start("ddxvideoload", str(clip), "-loop", "-rate", "0", "-readers", "1")
        wait_until(lambda: programs.count("ddxvideosave", "out") >= frames, "too few frames are recorded", patience=600)
        saver.terminate()
        saver.wait(60)
    return folder / "out.mp4"


def chromium(folder: pathlib.Path, clip: pathlib.Path) -> dict[str, float]:
    """ms from a wanted time to its picture."""
    file = recorded(folder, clip, MINUTES * 60 * drawn.RATE, QUALITY)
    player = Player(folder / "chromium")
    try:
        length, chance = player.load(file), random.Random(1)
        found = [player.seek(chance.uniform(0, length)) for _ in range(SEEKS)]
    finally:
        player.end()
    return {**view.summary(found), "minutes": round(length / 60, 1), "mb": round(file.stat().st_size / 1e6)}


def grey_frames(path: pathlib.Path, count: int) -> pathlib.Path:
    """1080p; each frame is one grey with noise, except in rows that have the pixel at which view.py looks."""
    (wide, high), chance = HD, numpy.random.default_rng(1)
    noise = [numpy.rint(chance.normal(0, SIGMA, wide * high * 3 // 2)) for _ in range(8)]
    for one in noise:
        one[380 * wide:680 * wide] = 0
    with path.open("wb") as file:
        file.write(b"YUV4MPEG2 W%d H%d F25:1 Ip A1:1 C420mpeg2\n" % HD)
        for number in range(count):
            plain = numpy.full(wide * high * 3 // 2, 128.0)
            plain[:wide * high] = round(16 + view.shade(number) * 219 / 255)
            file.write(b"FRAME\n" + (plain + noise[number % len(noise)]).astype(numpy.uint8).tobytes())
    return path


def viewer(folder: pathlib.Path) -> dict[str, dict[str, float]]:
    """ms from a key to its picture: forward through the file and back, over key frames, more than what is kept."""
    clip = grey_frames(folder.with_suffix(".y4m"), STEPPED)
    file = recorded(folder, clip, STEPPED, QUALITY)
    clip.unlink()
    with view.Screen() as screen:
        found = view.steps(screen, "ddxvideoview", file, STEPPED, STEPPED)
    return {way: {**view.summary(values), "max_ms": round(max(values), 1)} for way, values in found.items()}


def jumps(folder: pathlib.Path) -> dict[str, float]:
    """ms from a key to its picture: a minute up and down, to frames at each distance from their key frame."""
    minute = 60 * drawn.RATE
    clip = grey_frames(folder.with_suffix(".y4m"), LOOPED)
    file = recorded(folder, clip, MINUTES * minute, QUALITY)
    clip.unlink()
    found, at = [], 0
    with view.Screen() as screen, view.paused(screen, "ddxvideoview", file):
        time.sleep(SEARCHED)
        for _ in range(drawn.RATE):
            for key, way in ((b"Up", 1), (b"Down", -1)):
                for _ in range(2):
                    at += way * minute
                    found.append(view.pressed(screen, "ddxvideoview", key, at % LOOPED))
            at += 1
            view.pressed(screen, "ddxvideoview", b"period", at % LOOPED)
    result = {**view.summary(found), "max_ms": round(max(found), 1), "mb": round(file.stat().st_size / 1e6)}
    shutil.rmtree(folder)
    return result


def measure(folder: pathlib.Path, disk: pathlib.Path, options: argparse.Namespace) -> dict[str, Any]:
    cif = noisy(drawn.write(folder / "plain.y4m", 10), folder / "cif.y4m", drawn.WIDTH * drawn.HEIGHT * 3 // 2, 250)
    found: dict[str, Any] = {}

    def part(name: str, figures: Callable[[], Any]) -> None:
        if any(word in name for word in options.parts.split(",")):
            found[name] = figures()
            say(f"mp4: {name}: {json.dumps(found[name])}")

    part("cif", lambda: cost(folder / "cost", cif, options.seconds))
    part("pre_roll_s", lambda: {form: pre_roll(folder / "pre-roll", cif, options.wait, form)
                                for form in ("y4m", "h264")})
    if options.short:
        return found
    hd = noisy(hd_clip(folder / "waves.y4m"), folder / "hd.y4m", 1920 * 1080 * 3 // 2, 50)
    (folder / "waves.y4m").unlink()
    part("1080p", lambda: cost(folder / "cost", hd, options.seconds))
    part("1080p_lasting", lambda: lasting(disk / "lasting", hd, options.lasting, 0))
    part("1080p_beside_compilers", lambda: lasting(disk / "lasting", hd, options.lasting, 2))
    hd.unlink()
    part("viewer", lambda: viewer(folder / "viewer"))
    part("jumps", lambda: jumps(disk / "jumps"))
    part("chromium", lambda: chromium(folder / "long", cif))
    return found


def main() -> int:
    options = command_line(__doc__, seconds=60, lasting=60, parts="", short=False)
    options.wait = 25
    if options.short:
        options.seconds, options.wait = 3, 3
    native.build()
    if not options.short and not shutil.which("chromium"):
        raise Failed("chromium is not installed")
    with scratch(MEMORY) as folder, scratch(OUTPUT) as disk:
        found = measure(folder, disk, options)
    for size in set(found) & {"cif", "1080p"}:
        row = found[size]
        say(f"{size}: {row['percent']} % of a core, {row['ratio']} times x264 alone; {row['mb_s']} MB/s; "
            f"{row['memory_mb']} MB, Y4M {row['y4m_memory_mb']} MB; lost {row['lost']}")
    if not options.short and not options.parts:
        save("mp4", found)
    return 0


if __name__ == "__main__":
    finish("bench", main)
