#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""make test-long T=powercut: what do recordings lose in a power cut? See docs/recording.md.

powercut.py [-cuts N] [-seed N] [-format y4m|h264] [-naive]: a guest records, and all its writes are logged; then the
disk is rebuilt as a power cut between any two writes may have left it, checked and mounted as at a boot, and its
pictures are compared with the clip. Results: output/powercut/y4m.jsonl; a stopped run continues, a run with another
image records again. -format h264: lossless, into MP4 files; each must be finished, and FFmpeg decodes it. -naive: into
a file that grows, for comparison.
"""
import dataclasses
import hashlib
import json
import pathlib
import random
import re
import statistics
import subprocess
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import build
from parts.common import MEMORY, OUTPUT, Failed, command_line, finish, say, scratch
from parts.disk import blocklog, mbr
from parts.guest import disk_session, machine, testdisk
from parts.guest.qemu import Guest
from parts.guest.session import SAVE
from parts.image import native
from parts.media import clip as default_clip, crc32c, mp4, record_index, y4m
from parts.testing.campaign import Campaign

WORK = OUTPUT / "powercut"
REC, MARKS = 6, 3  # partitions; the second slot is empty
RATE = 25
SECONDS = 60       # of recording
Y4M, H264, NAIVE = "y4m", "h264", "naive"  # kinds of recording
SEGMENTS = {Y4M: 8, H264: 4, NAIVE: 0}  # MB: files end every two seconds, or five
BLOCK = 4096
Known = dict[bytes, tuple[list[int], bool]]  # numbers_of(), by the file's bytes
ENTRY = 64
NEAR = 2  # writes
MAX_LOSS = 1.0  # s
# A second of the guest is 500 million instructions, however busy the host is: otherwise a frame that waits for the host
# counts as loss.
COUNTED: dict[str, Any] = {"accel": "tcg,thread=single", "processors": 1, "extra": ("-icount", "shift=1")}
# Every second frame into MP4: this processor has little time left when it encodes each without loss, and frames that
# wait for the encoder count as loss.
SKIP = {Y4M: 1, H264: 2, NAIVE: 1}
SETTINGS = {Y4M: "full=recycle\\n", H264: "full=recycle\\nformat=h264\\nquality=0\\n", NAIVE: ""}
# A filler so that files are recycled after some seconds, a program that syncs each write, and one that marks each frame
# of the store: with priority, since a mark that comes late makes the loss too long.
NEIGHBOURS = ("dd if=/dev/zero of=/rec/filler bs=1M count={filler} 2> /dev/null; sync; "
              "(while :; do date > /rec/neighbour; fsync /rec/neighbour; sleep 0.05; done) > /dev/null 2>&1 & "
              "cp /test/marks /tmp; chmod 755 /tmp/marks; "
              f"chrt -f 50 /tmp/marks video /dev/vda{MARKS} > /dev/null 2>&1 &")


@dataclasses.dataclass
class Found:
    """After one cut."""
    cut: int
    model: str
    near: bool
    thorough: bool = False  # the quick check was not enough
    manual: bool = False    # nor was the thorough one
    mounted: bool = True
    frames: int = 0
    acknowledged_lost: int = 0
    corrupt: int = 0
    unfinished: int = 0     # MP4 files without a table
    loss: float = 0.0       # s


# ---- Record ----

def provide(disk: pathlib.Path, clip: pathlib.Path, board: str = machine.DEV) -> dict[str, Any]:
    """The guest's options for record()."""
    with scratch() as folder:
        content: testdisk.Files = {"ddxvideoload.conf": "loop=\n",
                                   "marks": disk_session.program("marks", folder, board)}
        return {"test_disk": testdisk.make(disk, clip, content), "provision": f"service={SAVE} off\n", **COUNTED}


def record(guest: Guest, kind: str, seconds: int) -> None:
    """Record, then cut the power: data that was not written yet is lost."""
    guest.shell()
    free = int(guest.sh("df -m /rec | awk 'NR == 2 { print $4 }'"))
    segment = SEGMENTS[kind]
    guest.sh(f"printf 'segment={segment}\\nskip={SKIP[kind]}\\n{SETTINGS[kind]}' > /data/ddx/{SAVE}.conf; "
             + NEIGHBOURS.format(filler=max(0, free - segment * 12 - 32) if segment else 0))
    guest.sh(f"ddxctl enable {SAVE}")
    for second in range(seconds):
        guest.sh("sleep 1")
        if second % 10 == 9:
            files = guest.sh("ls /rec | grep -c -E 'y4m|mp4' || true")
            say(f"powercut: recorded {second + 1} s of {seconds}, {files} files")
    guest.process.kill()


def writes(kind: str) -> pathlib.Path:
    return WORK / f"{kind}.log"


def campaign(made_of: Iterable[pathlib.Path], cuts: int, seed: int, kind: str) -> Campaign:
    log = writes(kind)
    return Campaign(log.with_suffix(".jsonl"), made_of, [log], cuts=cuts, seed=seed, seconds=SECONDS)


def log_writes(image: pathlib.Path, clip: pathlib.Path, kind: str) -> None:
    with Guest(image, machine=machine.machines(machine.DEV)[0], writes=writes(kind),
               **provide(WORK / "test.img", clip)) as guest:
        record(guest, kind, SECONDS)


# ---- Acknowledged frames ----

def promises(entry: blocklog.Entry) -> set[int]:
    """Store numbers of the frames whose index entries are in this write."""
    found: set[int] = set()
    for begin in range(0, len(entry.data) if len(entry.data) <= 64 * BLOCK else 0, BLOCK):
        for at in range(begin, begin + BLOCK, ENTRY):
            one = entry.data[at:at + ENTRY]
            if not any(one[:8]) or int.from_bytes(one[60:], "little") != crc32c.crc32c(one[:60]):
                break
            found.add(int.from_bytes(one[8:16], "little"))
    return found


@dataclasses.dataclass
class Moment:
    """The state when a write was done."""
    acknowledged: int  # highest store number in the index on the disk
    newest: int        # frame in the store
    event: bool        # a flush, or a write of metadata


def moments(log: pathlib.Path, part: mbr.Partition, marks: mbr.Partition) -> list[Moment]:
    found: list[Moment] = []
    pending, acknowledged, newest = 0, 0, -1
    for entry in blocklog.entries(log):
        if entry.is_flush:
            acknowledged = max(acknowledged, pending)
        inside = part.begin <= entry.offset < part.end
        numbers = promises(entry) if inside else set()
        pending = max([pending, *numbers])
        if marks.begin <= entry.offset < marks.end and (match := re.match(rb"mark (\d+) ", entry.data)):
            newest = int(match[1])
        metadata = inside and len(entry.data) <= BLOCK and not numbers
        found.append(Moment(acknowledged, newest, entry.is_flush or metadata))
    newest = found[-1].newest
    if newest < 0:
        raise Failed("no frame of the store was marked, so that no loss can be found")
    for one in reversed(found):  # the newest frame at the next mark
        one.newest, newest = newest, one.newest
    return found


def choose(seen: list[Moment], cuts: int, chance: random.Random) -> dict[int, bool]:
    """Writes after which the power is cut, and whether they are near an event, as half of them are."""
    with_index = seen[-1].acknowledged > 0  # recorded from the first promise on; before it, files are prepared
    begin = next((number for number, one in enumerate(seen)
                  if one.acknowledged or (not with_index and one.newest > 2 * RATE)), len(seen))
    events = [number for number in range(begin, len(seen)) if seen[number].event]
    if not events:
        raise Failed("nothing was recorded")
    chosen: dict[int, bool] = {}
    while len(chosen) < min(cuts, len(seen) - begin):
        near = len(chosen) % 2 == 0
        number = chance.choice(events) + chance.randint(-NEAR, NEAR) if near else chance.randrange(begin, len(seen))
        if begin <= number < len(seen):
            chosen.setdefault(number, near)
    return chosen


# ---- The disk after a cut ----

def due(folder: pathlib.Path, size: int) -> dict[str, list[int]]:
    """The pictures that each recording must have according to its index. The clip of `size` frames is looped."""
    found = {}
    for path in folder.glob("pool/*.index"):
        data = path.read_bytes()
        if len(data) > BLOCK and data[8] == record_index.NAMED:  # else the file was not finished
            index = record_index.parse(data)
            found[index.name] = [(entry.sequence - 1) % size for entry in index.entries]
    return found


def pictures_of(path: pathlib.Path, size: int) -> Iterator[bytes]:
    return mp4.pictures(path, size) if path.suffix == ".mp4" else (frame.data for frame in y4m.read(path)[1])


def numbers_of(path: pathlib.Path, pictures: dict[bytes, int], size: int, known: Known) -> tuple[list[int], bool]:
    """Numbers of the pictures in a file, and whether it was read to its end. Decoding takes most of the time, and most
    files are the same on the disks after many cuts: equal bytes are decoded once."""
    with path.open("rb") as file:
        digest = path.suffix.encode() + hashlib.file_digest(file, "blake2b").digest()
    if digest not in known:
        numbers, whole = list[int](), True
        try:
            for picture in pictures_of(path, size):
                numbers.append(pictures.get(hashlib.blake2b(picture).digest(), -1))
        except (y4m.Malformed, KeyError, ValueError, IndexError, UnicodeDecodeError):
            whole = False
        known[digest] = numbers, whole
    return known[digest]


def frames_of(folder: pathlib.Path, pictures: dict[bytes, int], size: int, skip: int,
              known: Known) -> tuple[list[int], int]:
    """Numbers of the pictures in all recordings in order, -1 for pictures that the clip lacks; and the corrupt ones:
    pictures with -1, files that cannot be read to their end, pictures that contradict the index, or, without an index,
    pictures that are not the next ones."""
    numbers: list[int] = []
    bad = 0
    said = due(folder, len(pictures))
    files = [*folder.glob("*.y4m"), *folder.glob("*.mp4")]
    for path in sorted(files, key=lambda path: int(path.name.split("-")[-2])):
        found, whole = numbers_of(path, pictures, size, known)
        numbers += found
        bad += not whole
        if path.name in said:
            bad += said[path.name] != found
        else:
            bad += sum((one + skip) % len(pictures) != later for one, later in zip(found, found[1:]))
    return numbers, bad + numbers.count(-1)


def check(image: pathlib.Path, found: Found) -> None:
    """Check the file system like overlay/etc/init.d/S15storage."""
    if subprocess.run(["e2fsck", "-p", image], capture_output=True, check=False).returncode >= 2:
        found.thorough = True
        found.manual = subprocess.run(["e2fsck", "-fy", image], capture_output=True, check=False).returncode >= 2


def unfinished(path: pathlib.Path) -> bool:
    try:
        return not mp4.is_finished(path)
    except y4m.Malformed:
        return True


def judge(image: pathlib.Path, found: Found, moment: Moment, pictures: dict[bytes, int], size: int, kind: str,
          known: Known) -> None:
    check(image, found)
    with scratch() as folder:
        if subprocess.run(["mount", "-o", "loop,noatime", image, folder], capture_output=True, check=False).returncode:
            found.mounted = False
            return
        try:
            if kind != NAIVE:
                root = OUTPUT / "desk/root/usr"
                libraries = next(root.glob("lib/**/libddx.so")).parent
                segment = str(SEGMENTS[kind])
                subprocess.run([root / "bin/ddxvideosave", "-output", folder, "-segment", segment, "-recover"],
                               env={"LD_LIBRARY_PATH": str(libraries)}, check=True, capture_output=True)
            numbers, found.corrupt = frames_of(folder, pictures, size, SKIP[kind], known)
            found.unfinished = sum(map(unfinished, folder.glob("*.mp4")))
        finally:
            subprocess.run(["umount", folder], check=True)
    found.frames = len(numbers)
    if not numbers:
        found.loss = (moment.newest + 1) / RATE
        found.acknowledged_lost = moment.acknowledged
        return
    # Store numbers begin with 1; picture numbers begin with 0 and wrap.
    count = len(pictures)
    behind = (moment.newest - numbers[-1]) % count  # the recording is never older than a round of the clip
    found.loss = max(0.0, (behind if behind < count // 2 else 0) / RATE)
    missing = (moment.acknowledged - 1 - numbers[-1]) % count
    found.acknowledged_lost = missing if moment.acknowledged and missing < count // 2 else 0


def replay(log: pathlib.Path, image: pathlib.Path, clip: pathlib.Path, kind: str, cuts: int, seed: int,
           done: Sequence[Found] = ()) -> Iterator[Found]:
    """The result of each cut that is not in `done`."""
    part = mbr.partition(image, REC)
    seen = moments(log, part, mbr.partition(image, MARKS))
    chosen = choose(seen, cuts, random.Random(seed))
    size = y4m.read(clip)[0].frame_size
    pictures = {hashlib.blake2b(frame.data).digest(): number for number, frame in enumerate(y4m.read(clip)[1])}
    with image.open("rb") as file:
        file.seek(part.begin)
        disk = blocklog.LoggedDisk(part.begin, file.read(part.end - part.begin))
    old = {(one.cut, one.model) for one in done}
    known: Known = {}
    with tempfile.NamedTemporaryFile(prefix="ddx-", suffix=".ext4", dir=MEMORY) as file:
        scratch = pathlib.Path(file.name)
        for number, entry in enumerate(blocklog.entries(log)):
            disk.add(entry)
            if number not in chosen:
                continue
            for model in ("prefix", "cache"):
                if (number, model) in old:
                    continue
                chance = random.Random(f"{seed} {number}")
                disk.make(scratch, disk.all_written() if model == "prefix" else disk.some_written(chance))
                found = Found(number, model, chosen[number])
                judge(scratch, found, seen[number], pictures, size, kind, known)
                yield found


def summary(done: list[Found]) -> dict[str, float]:
    return {"cuts": len(done), "near": sum(one.near for one in done),
            "thorough_fsck": sum(one.thorough for one in done),
            "manual_fsck": sum(one.manual for one in done), "mount_failures": sum(not one.mounted for one in done),
            "acked_lost": sum(one.acknowledged_lost > 0 for one in done),
            "corrupt": sum(one.corrupt > 0 for one in done),
            "unfinished": sum(one.unfinished > 0 for one in done),
            "median_loss_s": statistics.median(one.loss for one in done), "max_loss_s": max(one.loss for one in done)}


def broken(figures: dict[str, float]) -> bool:
    """Whether a promise was broken."""
    zero = ("manual_fsck", "mount_failures", "acked_lost", "corrupt", "unfinished")
    return any(figures[key] for key in zero) or figures["max_loss_s"] > MAX_LOSS


def main() -> int:
    arguments = command_line(__doc__, cuts=1000, seed=1, format=Y4M, naive=False)
    kind = NAIVE if arguments.naive else arguments.format
    if kind not in SEGMENTS:
        raise Failed(f"-format {kind}: y4m or h264 is needed")
    root = native.build()
    image = build.dev([root])
    steps = campaign([image, root], arguments.cuts, arguments.seed, kind)
    clip = default_clip.write(WORK / "clip.y4m", 20)
    steps.once("recorded", lambda: log_writes(image, clip, kind))
    done = [Found(**one) for one in steps.results.values() if one]
    for found in replay(writes(kind), image, clip, kind, arguments.cuts, arguments.seed, done):
        done.append(found)
        steps.add(f"{found.cut} {found.model}", dataclasses.asdict(found))
        if len(done) % 20 == 0:
            say(f"powercut: {len(done)} of {2 * arguments.cuts} disks")
    figures = summary(done)
    say(f"powercut: {json.dumps(figures)}")
    return int(broken(figures))


if __name__ == "__main__":
    finish("powercut", main)
