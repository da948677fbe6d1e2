#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""make test-long T=newmachine: each documented command on a bare Debian 12, as root and as a user with sudo.

usage: newmachine.py [NAME...]     the runs of these names; all, if none is given

Each run begins with nothing installed (tools/newmachine) and types what a new user types. Finished runs are kept in
output/newmachine/runs.jsonl with their seconds, and not repeated at the same commit.
"""
import dataclasses
import functools
import os
import pathlib
import subprocess
import sys
import time

from parts.common import OUTPUT, TOP, Failed, commit, finish, say
from parts.testing.campaign import Campaign

WORK = OUTPUT / "newmachine"
SECONDS = 5400  # of a run; limits a wait that would never end

# The commands that a new user types after `make desktop`: the examples of docs/store.md, with the clip of the bench.
FIRST_TRY = """
ddxctl -help > /dev/null && man -w ddx_store_open > /dev/null
mkdir try && cd try && cp ../examples/reader.c ../examples/reader.py .
cc reader.c -o reader $(pkg-config --cflags --libs ddx)
python3 -B ../tools/parts/media/clip.py clip.y4m 4
ddxstore -m 64M > /dev/null 2>&1 & store=$!
until ddxctl list > /dev/null 2>&1; do sleep 0.1; done
ddxvideoload clip.y4m -loop > /dev/null 2>&1 & loader=$!
until ddxctl list | grep -q video; do sleep 0.1; done
timeout 3 stdbuf -oL ./reader > c.txt || test $? = 124
timeout 3 python3 -u reader.py > python.txt || test $? = 124
kill "$loader" "$store"
test "$(wc -l < c.txt)" -gt 25 && test "$(wc -l < python.txt)" -gt 10
"""


@dataclasses.dataclass(frozen=True)
class Run:
    user: str
    script: str  # lines of a shell that exits at the first failure
    says: str = ""  # in the output; then the exit status does not count


RUNS = {
    "run": Run("root", "make run"),
    "run-as-user": Run("robot", "make run"),
    "clip": Run("root", "apt-get update -q && apt-get install -yq ffmpeg > /dev/null\n"
                        "ffmpeg -v error -f lavfi -i testsrc2=s=320x240:r=25:d=4 -pix_fmt yuv420p /tmp/my.y4m\n"
                        "make run CLIP=/tmp/my.y4m"),
    "camera": Run("root", "make run SOURCE=vivid"),
    "desktop": Run("root", f"apt-get update -q && apt-get install -yq man-db > /dev/null\nmake desktop\n{FIRST_TRY}"),
    "desktop-as-user": Run("robot", "sudo apt-get update -q && sudo apt-get install -yq man-db > /dev/null\n"
                                    f"make desktop\n{FIRST_TRY}"),
    "desktop-below-home": Run("robot", "make desktop PREFIX=$HOME/ddx\n"
                                       "LD_LIBRARY_PATH=$HOME/ddx/lib/x86_64-linux-gnu $HOME/ddx/bin/ddxctl -help"),
    "flash": Run("root", "make build\nmake flash BOARD=dev DEV=/root/card.img FILE=1 YES=1 HOSTNAME=robot1\n"
                         "test -s /root/card.img"),
    # There is no Buildroot on such a machine, and it is fetched from the network: what comes before that must pass.
    "image": Run("root", "make image BOARD=pc104 BUILDROOT_URL=file:///nowhere", "Buildroot 2026.02.3: cloning from"),
    "test": Run("root", "CI=true STRICT=1 sh .ci/run"),
}


def go(name: str) -> float:
    """Seconds that a run took; fails if the run did."""
    one, log = RUNS[name], WORK / f"{name}.log"
    say(f"newmachine: {name} ...")
    begin = time.monotonic()
    with log.open("w") as words:
        status = subprocess.run([TOP / "tools/newmachine", "sh", "-ec", one.script], stdin=subprocess.DEVNULL,
                                stdout=words, stderr=subprocess.STDOUT, timeout=SECONDS, check=False,
                                env={**os.environ, "USER_IS": one.user}).returncode
    said = log.read_text(errors="replace")
    if one.says and one.says in said:
        status = 0
    if status or "Traceback (most recent call last)" in said:
        raise Failed(f"{name} failed, exit status {status}; the end of {log.relative_to(TOP)}:\n" +
                     "\n".join(said.splitlines()[-15:]))
    seconds = round(time.monotonic() - begin, 1)
    say(f"newmachine: {name}: {seconds} s")
    return seconds


def main() -> int:
    names = sys.argv[1:] or list(RUNS)
    if unknown := [name for name in names if name not in RUNS]:
        raise Failed(f"no run {' '.join(unknown)}; there are {' '.join(RUNS)}")
    if commit().endswith("-dirty"):
        say("newmachine: the tree has changes that are not committed; the runs use the commit")
    WORK.mkdir(parents=True, exist_ok=True)
    steps = Campaign(WORK / "runs.jsonl", [TOP / "tools/newmachine", pathlib.Path(__file__)])
    for name in names:
        steps.once(name, functools.partial(go, name))
    say(f"newmachine: {len(names)} runs passed")
    return 0


if __name__ == "__main__":
    finish("newmachine", main)
