# SPDX-License-Identifier: GPL-2.0-or-later
"""`make flash` on loop devices: writes, refusals and failures. The image has the real layout, but is small."""
from __future__ import annotations

import base64
import hashlib
import os
import pathlib
import pty
import re
import shutil
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Iterator

import pytest

import flash
from parts.common import SBIN, TOP, Failed, run
from parts.disk import mbr
from parts.flash import blockio, blockmap, provision, target
from parts.media.recording import FileSystem

pytestmark = pytest.mark.retry

MIB = 2**20
ENVIRONMENT = {**os.environ, **SBIN, "LC_ALL": "C"}


@pytest.fixture(scope="module")
def image(tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    """A disk image made by the boards' script and description, with smaller partitions."""
    folder = tmp_path_factory.mktemp("image")
    shutil.copytree(TOP / "board/common", folder / "common")
    config = folder / "common/disk.cfg"
    config.write_text(re.sub(r"size = (512|64)M", lambda m: {"512": "size = 20M", "64": "size = 10M"}[m[1]],
                             config.read_text()))
    (folder / "root").mkdir()
    (folder / "root/file").write_bytes(os.urandom(MIB))
    run(["mksquashfs", folder / "root", folder / "rootfs.squashfs", "-quiet", "-no-progress"])
    run([folder / "common/post-image.sh"], env={"BINARIES_DIR": str(folder)})
    return folder / "disk.img"


def test_the_same_disk_is_made_at_any_time(image: pathlib.Path, tmp_path: pathlib.Path) -> None:
    """With SOURCE_DATE_EPOCH, as set by Buildroot (BR2_REPRODUCIBLE); without it the disk contains build times."""
    made: dict[str, set[bytes]] = {"": set(), "1700000000": set()}
    for number in range(2):
        for epoch, disks in made.items():
            folder = tmp_path / f"{number}{epoch}"
            folder.mkdir()
            shutil.copy(image.parent / "rootfs.squashfs", folder)
            run([image.parent / "common/post-image.sh"],
                env={"BINARIES_DIR": str(folder), "SOURCE_DATE_EPOCH": epoch})
            disks.add(hashlib.sha256((folder / "disk.img").read_bytes()).digest())
        time.sleep(2.1)  # FAT times have steps of two seconds
    assert (len(made[""]), len(made["1700000000"])) == (2, 1)


def losetup(*options: str | os.PathLike[str]) -> str:
    return subprocess.run(["losetup", *options], env=ENVIRONMENT, capture_output=True, text=True, check=True).stdout


class Loop:
    """A loop device on a file."""

    def __init__(self, file: pathlib.Path, *options: str) -> None:
        self.file = file
        self.device = losetup("--find", "--show", "--partscan", *options, file).strip()
        self.name = pathlib.Path(self.device).name

    def partitions(self) -> dict[str, int]:
        """The partitions that the kernel knows, with their first sectors."""
        found = pathlib.Path("/sys/block", self.name).glob("*/partition")
        return {file.parent.name: int((file.parent / "start").read_text()) for file in found}

    def add_partitions(self) -> None:
        """Add the partitions to the kernel, which may not read such tables."""
        subprocess.run(["partx", "--add", self.device], env=ENVIRONMENT, capture_output=True, check=False)
        assert self.partitions()

    def close(self) -> None:
        subprocess.run(["partx", "--delete", self.device], env=ENVIRONMENT, capture_output=True, check=False)
        losetup("--detach", self.device)


@pytest.fixture
def loop(tmp_path: pathlib.Path, image: pathlib.Path) -> Iterator[Loop]:
    """A larger disk full of old data; its first MiB shows whether it was written."""
    if os.geteuid() != 0 or not os.access("/dev/loop-control", os.R_OK | os.W_OK):
        pytest.skip("needs root and loop devices")
    file = tmp_path / "target.img"
    noise = os.urandom(MIB)
    with file.open("wb") as out:
        for _ in range(image.stat().st_size // MIB + 8):
            out.write(noise)
    try:
        made = Loop(file)
    except subprocess.CalledProcessError as error:
        pytest.skip(f"loop devices do not work here: {error.stderr.strip()}")
    yield made
    made.close()


def tool(*words: str, stdin: int = subprocess.DEVNULL) -> tuple[int, str]:
    done = subprocess.run([sys.executable, "-B", TOP / "tools/flash.py", *words], stdin=stdin, stdout=subprocess.PIPE,
                          stderr=subprocess.STDOUT, text=True, timeout=120)
    return done.returncode, done.stdout


def old_table(loop: Loop) -> None:
    """Write a table with two partitions of 8 MiB, as on a used card."""
    subprocess.run(["sfdisk", "--quiet", "--no-reread", "--label", "dos", loop.device], env=ENVIRONMENT, text=True,
                   input="start=2048,size=16384\nstart=18432,size=16384\n", capture_output=True, check=True)
    loop.add_partitions()


def probe(disk: pathlib.Path, *options: str) -> dict[str, str]:
    """The signatures that blkid finds."""
    text = subprocess.run(["blkid", "--probe", "--output", "export", *options, disk], env=ENVIRONMENT, text=True,
                          capture_output=True, check=False).stdout
    return dict(line.split("=", 1) for line in text.splitlines() if "=" in line)


def probe_partition(disk: pathlib.Path, number: int) -> dict[str, str]:
    place = mbr.partition(disk, number)
    return probe(disk, "--offset", str(place.begin), "--size", str(place.end - place.begin))


def check_disk(disk: pathlib.Path, image: pathlib.Path) -> None:
    """Check that the disk equals the image, and no signature of old data is left."""
    assert probe(disk)["PTTYPE"] == "dos"
    with disk.open("rb") as written, image.open("rb") as wanted:
        for number in (1, 2):
            place = mbr.partition(image, number)
            length = place.end - place.begin if number == 1 else 4096 * 64
            written.seek(place.begin)
            wanted.seek(place.begin)
            assert written.read(length) == wanted.read(length)
        written.seek(0)
        wanted.seek(0)
        begin, ours = written.read(MIB), wanted.read(MIB)
        assert begin[:440] == ours[:440] and begin[444:] == ours[444:]
        assert begin[440:444] != ours[440:444]  # each disk gets its own signature
    kinds = [probe_partition(disk, number).get("TYPE") for number in (1, 2, 3, 5, 6)]
    assert kinds == ["vfat", "squashfs", None, "ext4", "ext4"]
    for number in (5, 6):
        run(["e2fsck", "-fn", f"{disk}?offset={mbr.partition(disk, number).begin}"])
        assert re.findall(r"^/\d+/\d+/\d+/\d+/([^/]+)/", FileSystem(disk, number)._debugfs("ls -p /"), re.M) == [
            ".", "..", "lost+found"]


def test_a_disk_full_of_old_data_becomes_the_image(image: pathlib.Path, loop: Loop) -> None:
    subprocess.run(["sfdisk", "--quiet", "--no-reread", "--label", "gpt", loop.device], input="size=8M\n",
                   env=ENVIRONMENT, text=True, capture_output=True, check=True)
    slot = mbr.partition(image, 3)
    second = 4 * MIB  # where LUKS may keep its second header
    luks = b"SKUL\xba\xbe" + struct.pack(">HQQ232xQ", 2, 4 * MIB, 1, second)
    with loop.file.open("r+b") as file:
        file.seek(slot.begin + second)
        file.write(luks + bytes(4096 - len(luks)))
    assert probe(loop.file)["PTTYPE"] == "gpt"
    where = ["--offset", str(slot.begin), "--size", str(slot.end - slot.begin)]
    assert probe(loop.file, *where)["TYPE"] == "crypto_LUKS"

    status, text = tool(f"IMAGE={image}", f"DEV={loop.device}", "YES=1")
    assert status == 0, text
    assert text.startswith(f"{loop.device}: loop device on {loop.file}, ")
    assert "written and compared" in text
    check_disk(loop.file, image)
    with loop.file.open("rb") as file:
        file.seek(-MIB, os.SEEK_END)
        assert not file.read().strip(b"\0"), "the end of the disk"


def test_only_used_blocks_are_written(image: pathlib.Path, loop: Loop) -> None:
    ranges = blockmap.used(image, loop.file.stat().st_size)
    total = sum(one.end - one.begin for one in ranges)
    assert total < image.stat().st_size - 10 * MIB
    before = loop.file.read_bytes()
    assert tool(f"IMAGE={image}", f"DEV={loop.device}", "YES=1")[0] == 0
    after, position = loop.file.read_bytes(), 0
    for one in ranges:
        assert after[position:one.begin] == before[position:one.begin]
        position = one.end


def test_files_of_the_old_system_are_gone(image: pathlib.Path, loop: Loop) -> None:
    words = [f"IMAGE={image}", f"DEV={loop.device}", "YES=1"]
    assert tool(*words)[0] == 0
    for number in (5, 6):  # the same file system identity: old inodes would look valid
        place = f"{loop.file}?offset={mbr.partition(image, number).begin}"
        requests = "".join(f"write {TOP}/Makefile file{n}\nmkdir folder{n}\n" for n in range(2))
        subprocess.run(["debugfs", "-w", place], env=ENVIRONMENT, input=requests, capture_output=True, text=True,
                       check=True)
        assert "file1" in FileSystem(loop.file, number)._debugfs("ls -p /")
    assert tool(*words)[0] == 0
    check_disk(loop.file, image)


def test_a_doubtful_file_system_is_written_completely(image: pathlib.Path, tmp_path: pathlib.Path) -> None:
    copy = tmp_path / "disk.img"
    run(["cp", "--sparse=always", image, copy])
    place = mbr.partition(copy, 5)
    assert blockmap._free(copy, place)
    run(["debugfs", "-w", "-R", "feature needs_recovery", f"{copy}?offset={place.begin}"])
    assert not blockmap._free(copy, place)


def test_the_kernel_forgets_the_old_partitions(image: pathlib.Path, loop: Loop) -> None:
    old_table(loop)
    old = loop.partitions()
    assert tool(f"IMAGE={image}", f"DEV={loop.device}", "YES=1")[0] == 0
    new = {one.begin // 512 for one in mbr.partitions(image)} | {mbr.partition(image, 5).begin // 512 - 2048}
    assert loop.partitions() != old and set(loop.partitions().values()) <= new


def test_shows_the_contents_of_the_disk(image: pathlib.Path, loop: Loop) -> None:
    assert tool(f"IMAGE={image}", f"DEV={loop.device}", "YES=1")[0] == 0
    status, text = tool(f"IMAGE={image}", f"DEV={loop.device}")
    assert status == 2
    for line in ["partition 1: 16.8 MB, vfat DDXBOOT", "partition 5: 10.5 MB, ext4 DDXDATA", "partition 6: 21.0 MB, "]:
        assert f"  {line}" in text
    assert "partition 4" not in text


# Refusals: one line, exit status 2, nothing written.

def refused(image: pathlib.Path, device: str, because: str, *words: str, untouched: pathlib.Path | None = None) -> None:
    before = hashlib.sha256(untouched.read_bytes()).digest() if untouched else b""
    status, text = tool(f"IMAGE={image}", f"DEV={device}", "YES=1", *words)
    assert status == 2, text
    assert text.count("flash: ") == 1 and "Traceback" not in text
    assert because in text.splitlines()[-1]
    assert not untouched or hashlib.sha256(untouched.read_bytes()).digest() == before


def test_refuses_files_and_other_devices(image: pathlib.Path, tmp_path: pathlib.Path) -> None:
    refused(image, str(tmp_path / "nothing"), "there is no such device")
    refused(image, "/dev/null", "is not a block device")
    file = tmp_path / "file"
    file.write_bytes(b"precious")
    refused(image, str(file), "is not a block device", untouched=file)


def test_refuses_a_partition(image: pathlib.Path, loop: Loop) -> None:
    old_table(loop)
    refused(image, f"{loop.device}p1", f"is a partition; name the whole disk, {loop.device}", untouched=loop.file)


def test_refuses_a_disk_with_a_mounted_partition(image: pathlib.Path, loop: Loop, tmp_path: pathlib.Path) -> None:
    old_table(loop)
    run(["mkfs.vfat", f"{loop.device}p2"])
    point = tmp_path / "with space"
    point.mkdir()
    if subprocess.run(["mount", "-o", "ro", f"{loop.device}p2", point], capture_output=True, check=False).returncode:
        run(["mke2fs", "-qF", f"{loop.device}p2"])  # a kernel without FAT
        run(["mount", "-o", "ro", f"{loop.device}p2", point])
    try:
        refused(image, loop.device, f"{loop.device}p2 is mounted on {point}; unmount it first", untouched=loop.file)
    finally:
        run(["umount", point])


def test_refuses_a_mounted_disk(image: pathlib.Path, loop: Loop, tmp_path: pathlib.Path) -> None:
    run(["mke2fs", "-qF", loop.device])
    (tmp_path / "point").mkdir()
    run(["mount", "-o", "ro", loop.device, tmp_path / "point"])
    try:
        refused(image, loop.device, f"{loop.device} is mounted on {tmp_path}/point", untouched=loop.file)
    finally:
        run(["umount", tmp_path / "point"])


def test_refuses_swap(image: pathlib.Path, loop: Loop) -> None:
    old_table(loop)
    run(["mkswap", f"{loop.device}p1"])
    if subprocess.run(["swapon", f"{loop.device}p1"], env=ENVIRONMENT, capture_output=True, check=False).returncode:
        pytest.skip("no swap here")
    try:
        refused(image, loop.device, f"{loop.device}p1 is in use as swap")
    finally:
        run(["swapoff", f"{loop.device}p1"])


def test_refuses_a_disk_below_another_device(image: pathlib.Path, loop: Loop) -> None:
    upper = losetup("--find", "--show", loop.device).strip()
    try:
        refused(image, loop.device, f"{loop.device} is in use by {upper}", untouched=loop.file)
    finally:
        losetup("--detach", upper)


def test_refuses_a_disk_in_use_by_another_program(image: pathlib.Path, loop: Loop) -> None:
    held = os.open(loop.device, os.O_RDWR | os.O_EXCL)
    try:
        refused(image, loop.device, "is in use by another program", untouched=loop.file)
    finally:
        os.close(held)


def test_refuses_a_small_a_locked_and_an_odd_disk(image: pathlib.Path, loop: Loop, tmp_path: pathlib.Path) -> None:
    need = image.stat().st_size
    small = f"too small: it has {need - 512:,} bytes, the image needs {need:,}"
    cases: list[tuple[int, list[str], str]] = [
        (need - 512, [], small), (need, ["--read-only"], "is read-only"),
        (need, ["--sector-size", "4096"], "sectors of 4096 bytes")]
    for size, options, because in cases:
        file = tmp_path / "other.img"
        with file.open("wb") as out:
            out.truncate(size)
        other = Loop(file, *options)
        try:
            refused(image, other.device, because, untouched=file)
        finally:
            other.close()


def test_accepts_a_disk_of_exactly_the_needed_size(image: pathlib.Path, loop: Loop, tmp_path: pathlib.Path) -> None:
    file = tmp_path / "other.img"
    with file.open("wb") as out:
        out.truncate(image.stat().st_size)
    other = Loop(file)
    try:
        assert tool(f"IMAGE={image}", f"DEV={other.device}", "YES=1")[0] == 0
    finally:
        other.close()
    check_disk(file, image)


def test_refuses_the_disk_that_this_system_runs_from(tmp_path: pathlib.Path) -> None:
    """Calls only the check, and never the tool with that disk."""
    disks = [name for name in target.system_disks() if (pathlib.Path("/sys/block") / name / "device").exists()]
    if not disks or os.geteuid() != 0:
        pytest.skip("needs root, and a visible disk with the root file system")
    major, minor = map(int, pathlib.Path("/sys/block", disks[0], "dev").read_text().split(":"))
    node = tmp_path / disks[0]
    os.mknod(node, 0o600 | 0o060000, os.makedev(major, minor))
    with pytest.raises(Failed, match="is the disk that this system runs from"):
        target.TargetDisk(node).refuse(0)


class FakeSystem:
    """A simulated system for target.py, with disks that this machine does not have."""

    def __init__(self, folder: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.sys, self.proc, self.dev = folder / "sys", folder / "proc", folder / "dev"
        self.numbers: dict[str, str] = {}
        self.mounts: list[str] = []
        for part in [self.sys / "dev/block", self.sys / "block", self.proc / "self", self.dev]:
            part.mkdir(parents=True)
        monkeypatch.setattr(target, "SYS", self.sys)
        monkeypatch.setattr(target, "PROC", self.proc)
        monkeypatch.setattr(target, "_number", lambda path: self.numbers.get(str(path), ""))

    def add(self, place: str, number: str, **files: str) -> pathlib.Path:
        """sda, sda/sda1, dm-0 ..."""
        folder = self.sys / "block" / place
        folder.mkdir(parents=True)
        for name, text in {"dev": number, "size": "2000000", **files}.items():
            (folder / name).parent.mkdir(exist_ok=True)
            (folder / name).write_text(text)
        (self.sys / "dev/block" / number).symlink_to(folder)
        self.numbers[str(self.dev / folder.name)] = number
        (self.dev / folder.name).touch()
        return folder

    def stack(self, upper: str, lower: str) -> None:
        top, below = self.sys / "block" / upper, self.sys / "block" / lower
        for folder, other in [(top / "slaves", below), (below / "holders", top)]:
            folder.mkdir(exist_ok=True)
            (folder / other.name).symlink_to(other)

    def mount(self, number: str, where: str, kind: str = "ext4", source: str = "/dev/x") -> None:
        self.mounts.append(f"30 1 {number} / {where} rw,relatime shared:1 - {kind} {source} rw")
        (self.proc / "self/mountinfo").write_text("\n".join(self.mounts))

    def refusal(self, name: str) -> str:
        try:
            target.TargetDisk(self.dev / name).refuse(0)
        except Failed as error:
            return str(error)
        return ""


@pytest.fixture
def fake(tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> FakeSystem:
    system = FakeSystem(tmp_path, monkeypatch)
    for letter, number in [("a", 0), ("b", 16)]:
        system.add(f"sd{letter}", f"8:{number}")
        system.add(f"sd{letter}/sd{letter}1", f"8:{number + 1}", partition="1")
    return system


def test_a_free_disk_is_not_refused(fake: FakeSystem) -> None:
    fake.mount("8:1", "/")
    assert fake.refusal("sdb") == ""


def test_refuses_an_empty_card_reader(fake: FakeSystem) -> None:
    """Simulated, since a user could insert a card into a real reader."""
    fake.add("sdc", "8:32", size="0", removable="1")
    assert fake.refusal("sdc").endswith("sdc is empty: no card in the reader?")


def test_the_system_is_found_through_encryption_and_volumes(fake: FakeSystem) -> None:
    fake.add("dm-0", "252:0", **{"dm/name": "crypt"})
    fake.add("dm-1", "252:1", **{"dm/name": "vg-root"})
    fake.stack("dm-0", "sda/sda1")
    fake.stack("dm-1", "dm-0")
    fake.mount("252:1", "/")
    assert fake.refusal("sda").endswith("sda is the disk that this system runs from")
    assert fake.refusal("sdb") == ""
    assert fake.refusal("dm-1").endswith("dm-1 is a device-mapper volume; name a real disk")


def test_the_system_is_found_on_btrfs(fake: FakeSystem) -> None:
    fake.mount("0:25", "/", "btrfs", str(fake.dev / "sda1"))
    assert fake.refusal("sda").endswith("sda is the disk that this system runs from")


def test_refuses_members_of_volumes_and_raids(fake: FakeSystem) -> None:
    fake.add("md0", "9:0", **{"md/level": "raid1"})
    fake.add("dm-0", "252:0", **{"dm/name": "vg-films"})
    fake.stack("md0", "sda/sda1")
    fake.stack("dm-0", "sdb")
    assert "sda1 is part of md0 (LVM, RAID or encryption)" in fake.refusal("sda")
    assert "sdb is part of vg-films (LVM, RAID or encryption)" in fake.refusal("sdb")
    assert fake.refusal("md0").endswith("md0 is a RAID; name a real disk")


def test_refuses_bad_words(image: pathlib.Path, tmp_path: pathlib.Path) -> None:
    for words, because in [(["BOARD=dev"], "which disk?"), (["DEV=/dev/null"], "which image?"),
                           (["BOARD=../x", "DEV=/dev/null"], "not the name of a board"),
                           (["BOARD=no-such", "DEV=/dev/null"], "build it first"),
                           (["COLOR=red"], "unknown word COLOR=red"), (["YES=yes"], "say YES=1"),
                           ([f"IMAGE={TOP}/Makefile", "DEV=/dev/null"], "is not a disk image")]:
        status, text = tool(*words)
        assert (status, because in text, text.count("\n")) == (2, True, 1), text


def test_asks_for_the_name_of_the_disk(image: pathlib.Path, loop: Loop) -> None:
    words = [f"IMAGE={image}", f"DEV={loop.device}"]
    for answer, expected in [("\n", 2), ("y\n", 2), (f"{loop.name}\n", 0)]:
        leader, follower = pty.openpty()
        os.write(leader, answer.encode())
        status, text = tool(*words, stdin=follower)
        os.close(follower)
        os.close(leader)
        assert status == expected, text
        assert f"Everything on {loop.device} will be lost. Type {loop.name} to go on: " in text
        assert ("nothing was written" in text) == (expected == 2)
    status, text = tool(*words)
    assert status == 2 and "no terminal to ask at" in text


# Failures: one line, exit status 1, and a disk that does not boot.

def main_of(*words: str) -> int:
    """Run the tool in this process, so that faults can be injected."""
    handlers = {name: signal.getsignal(name) for name in (signal.SIGTERM, signal.SIGHUP)}
    try:
        return flash.main(list(words))
    finally:
        for name, handler in handlers.items():
            signal.signal(name, handler)


def has_no_start(file: pathlib.Path) -> bool:
    with file.open("rb") as disk:
        return not disk.read(MIB).strip(b"\0")


def test_a_disk_that_fails_while_writing(image: pathlib.Path, loop: Loop, tmp_path: pathlib.Path) -> None:
    """A loop device whose file system is full: the kernel reports an error for the blocks that have no room."""
    (tmp_path / "small").mkdir()
    run(["mount", "-t", "tmpfs", "-o", "size=20m", "tmpfs", tmp_path / "small"])
    try:
        file = tmp_path / "small/disk.img"
        with file.open("wb") as out:
            out.truncate(image.stat().st_size)
        bad = Loop(file)
        try:
            status, text = tool(f"IMAGE={image}", f"DEV={bad.device}", "YES=1")
            assert status == 1 and "Traceback" not in text
            reason = r"byte [\d,]+: (Input/output error|No space left on device)"
            assert re.fullmatch(f"flash: {bad.device} cannot be written at {reason}", text.splitlines()[-1]), text
            assert has_no_start(file)
        finally:
            bad.close()
    finally:
        run(["umount", tmp_path / "small"])


@pytest.mark.parametrize("offset", [20 * MIB + 12345, 1000])
def test_a_disk_that_returns_other_data(image: pathlib.Path, loop: Loop, monkeypatch: pytest.MonkeyPatch,
                                            capsys: pytest.CaptureFixture[str], offset: int) -> None:
    settle = blockio.Device.settle

    def spoil(device: blockio.Device) -> None:
        settle(device)
        with loop.file.open("r+b") as file:
            file.seek(offset)
            byte = file.read(1)[0]
            file.seek(offset)
            file.write(bytes([byte ^ 1]))

    monkeypatch.setattr(blockio.Device, "settle", spoil)
    assert main_of(f"IMAGE={image}", f"DEV={loop.device}", "YES=1") == 1
    assert f"differs from what was written at byte {offset:,}" in capsys.readouterr().out.splitlines()[-1]
    assert has_no_start(loop.file)


def test_an_interrupted_disk_does_not_boot(image: pathlib.Path, loop: Loop, monkeypatch: pytest.MonkeyPatch,
                                           capsys: pytest.CaptureFixture[str]) -> None:
    add = flash.Progress.add

    def pull(progress: flash.Progress, count: int) -> None:
        add(progress, count)
        if progress.done > progress.total // 2:
            os.kill(os.getpid(), signal.SIGTERM)

    monkeypatch.setattr(flash.Progress, "add", pull)
    assert main_of(f"IMAGE={image}", f"DEV={loop.device}", "YES=1") == 1
    assert capsys.readouterr().out.splitlines()[-1].startswith("flash: interrupted; the disk is not complete")
    assert has_no_start(loop.file)


# Settings of one machine

def public_key(comment: str = "me@here") -> str:
    kind = b"ssh-ed25519"
    body = len(kind).to_bytes(4, "big") + kind + (32).to_bytes(4, "big") + os.urandom(32)
    return f"ssh-ed25519 {base64.b64encode(body).decode()} {comment}"


def test_writes_the_machine_s_name_and_keys(image: pathlib.Path, loop: Loop, tmp_path: pathlib.Path) -> None:
    before = hashlib.sha256(image.read_bytes()).digest()
    keys = [public_key(), public_key("you with spaces")]
    file = tmp_path / "my keys.pub"
    file.write_text("# ours\n" + "\n".join(keys) + "\n")
    status, text = tool(f"IMAGE={image}", f"DEV={loop.device}", "YES=1", "HOSTNAME=robot-7", "CONSOLE=open",
                        "SERIAL=on", f"SSH_KEY={file}", "NETWORK=eth0 dhcp")
    assert status == 0 and "warning" not in text, text
    boot = f"{loop.file}@@{mbr.partition(image, 1).begin}"
    settings = run(["mtype", "-i", boot, "::ddx.txt"])
    shipped = (TOP / "board/common/ddx.txt").read_text()
    assert settings == (shipped + "hostname=robot-7\nconsole=open\nnetwork=eth0 dhcp\n"
                        + "".join(f"ssh_key={key}\n" for key in keys))
    names = run(["mdir", "-b", "-i", boot, "::"]).split()
    assert "::/serial-on.txt" in names and "::/serial-off.txt" not in names
    assert hashlib.sha256(image.read_bytes()).digest() == before


def test_warns_of_a_machine_that_no_key_can_reach(image: pathlib.Path, loop: Loop, tmp_path: pathlib.Path) -> None:
    file = tmp_path / "key.pub"
    file.write_text(f"{public_key()}\n")
    status, text = tool(f"IMAGE={image}", f"DEV={loop.device}", "YES=1", f"SSH_KEY={file}")
    assert status == 0 and "warning: the keys cannot log in, because the machine has no network" in text
    assert "NETWORK='eth0 dhcp'" in text


@pytest.mark.parametrize("text", ["", "nonsense\n", "ssh-rsa {body}\n", 'command="sh" ssh-ed25519 {body}\n',
                                  "ssh-ed25519 ????\n", "ssh-ed25519 {body} me\nconsole=open\n"])
def test_checks_public_keys(tmp_path: pathlib.Path, text: str) -> None:
    (tmp_path / "key.pub").write_text(text.format(body=public_key().split(" ")[1]))
    with pytest.raises(Failed, match="not a file of SSH public keys"):
        provision.lines(str(tmp_path / "key.pub"), "", "")


@pytest.mark.parametrize("name", ["Robot", "-x", "x-", "a b", "a" * 64, "x\nconsole=open", "x\n"])
def test_checks_host_names(name: str) -> None:
    with pytest.raises(Failed, match="small letters, digits|a single line is needed"):
        provision.lines("", name, "")


def test_new_lines_replace_old_ones() -> None:
    text = "# hostname=no\nhostname=old\nconsole=open\nssh_key=a"
    assert provision.merge(text, ["hostname=new", "ssh_key=b", "ssh_key=c"]) == (
        "# hostname=no\nconsole=open\nhostname=new\nssh_key=b\nssh_key=c\n")


def test_refuses_invalid_settings(image: pathlib.Path, loop: Loop, tmp_path: pathlib.Path) -> None:
    (tmp_path / "key").write_text("-----BEGIN OPENSSH PRIVATE KEY-----\n")
    refused(image, loop.device, "this is a private key", f"SSH_KEY={tmp_path}/key", untouched=loop.file)
    refused(image, loop.device, "cannot be read: No such file", f"SSH_KEY={tmp_path}/none")
    refused(image, loop.device, "open or closed is needed", "CONSOLE=yes")
    refused(image, loop.device, "NETWORK=eth0: dhcp is needed, or an address", "NETWORK=eth0")
    refused(image, loop.device, "SERIAL=on", "SERIAL=open")


# A file instead of a disk

def test_writes_a_file_on_request(image: pathlib.Path, tmp_path: pathlib.Path) -> None:
    file = tmp_path / "card.img"
    sure: list[list[str]] = [[], ["YES=1"]]
    for words in sure:  # new, then over itself
        status, text = tool(f"IMAGE={image}", f"DEV={file}", "FILE=1", *words)
        assert status == 0, text
        check_disk(file, image)
    assert "no terminal" in tool(f"IMAGE={image}", f"DEV={file}", "FILE=1")[1]
    refused(image, str(image), "is the image itself", "FILE=1")
    refused(image, "/dev/null", "is not a file", "FILE=1")
    file.write_bytes(b"precious")
    refused(image, str(file), "too small", "FILE=1", untouched=file)


def test_refuses_a_device_as_a_file_and_a_file_below_a_device(image: pathlib.Path, loop: Loop) -> None:
    refused(image, loop.device, "FILE=1 is for files", "FILE=1", untouched=loop.file)
    refused(image, str(loop.file), f"is in use by {loop.device}", "FILE=1", untouched=loop.file)


# The make target

def test_make_passes_on_only_variables_of_the_command_line(tmp_path: pathlib.Path) -> None:
    environment = {**os.environ, "HOSTNAME": "builder", "YES": "1", "DEV": "/dev/wrong"}
    text = subprocess.run(["make", "--dry-run", "flash", "BOARD=dev", "SSH_KEY=my keys.pub"], cwd=TOP, env=environment,
                          capture_output=True, text=True, check=True).stdout.splitlines()[-1]
    assert text.split("flash.py", 1)[1].split() == ["BOARD='dev'", "SSH_KEY='my", "keys.pub'"]
