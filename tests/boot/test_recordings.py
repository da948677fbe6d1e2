# SPDX-License-Identifier: GPL-2.0-or-later
"""Recordings are exported to a USB stick, and an update is read from one, while the recorder goes on and loses
nothing."""
import json
import pathlib
import subprocess
import time
from typing import Any

import pytest

from parts.common import PATIENCE, run
from parts.guest.qemu import Guest
from parts.media import counters, y4m
from parts.media.recording import FileSystem

from . import slot_image
from .conftest import STICK_MB

pytestmark = pytest.mark.retry

SAVE = "ddxvideosave"


def ctl(guest: Guest, words: str, seconds: float = PATIENCE) -> tuple[int, str]:
    status, text = guest.shell().run(f"ddxctl recordings {words}", seconds)
    return status, text.strip()


def save_counters(guest: Guest) -> counters.Counters:
    """The recorder's counters."""
    return counters.of(SAVE, guest.sh("ddxctl stats --json"))[0]


def on_stick(stick: pathlib.Path) -> list[str]:
    return sorted(run(["mdir", "-b", "-i", stick]).replace("::/", "").split())


def listed(guest: Guest) -> list[dict[str, Any]]:
    return [json.loads(line) for line in ctl(guest, "list --json")[1].splitlines()]


def test_a_running_recording_is_listed_as_one(recorder: Guest) -> None:
    recorder.wait_until("ls /rec/*.y4m | wc -l | grep -q '[3-9]'")
    found = listed(recorder)
    assert [one["state"] for one in found] == ["recording"] and len(found[0]["files"]) > 1


def test_an_export_while_recording(recorder: Guest, stick: pathlib.Path, work: pathlib.Path) -> None:
    before = save_counters(recorder)
    begin = time.monotonic()
    status, text = ctl(recorder, "export all usb")
    print(f"export took {time.monotonic() - begin:.1f} s")
    assert status == 0, text
    assert text.splitlines()[-1] == "/dev/sda: may be removed"
    after = save_counters(recorder)
    assert after.lost_total == before.lost_total and after.out > before.out + 25
    assert recorder.shell().run("grep -q export /proc/mounts")[0] == 1
    names = on_stick(stick)
    assert len(names) >= 3
    assert listed(recorder)[0]["files"][:len(names)] == names
    recorder.sh("sync")
    disk = FileSystem(recorder.snapshot())
    for name in names:
        run(["mcopy", "-n", "-o", "-i", stick, f"::/{name}", work / "copy.y4m"])
        assert (work / "copy.y4m").read_bytes() == disk.take(name, work / "original.y4m").read_bytes()
        assert len(list(y4m.read(work / "copy.y4m")[1])) > 30


@pytest.mark.parametrize("target, says", [
    ("/dev/vda", "is the machine's own disk"),
    ("/dev/vda6", "is the machine's own disk"),
    ("/rec", "is on the machine's own disk"),
    ("/data", "is on the machine's own disk"),
    ("/tmp", "is in the machine's memory"),
    ("/dev/vdb", "is in use at /test"),
    ("/dev/sdz", "there is no such device"),
    ("/nowhere", "there is no such device or folder"),
])
def test_targets_that_are_refused(recorder: Guest, target: str, says: str) -> None:
    status, text = ctl(recorder, f"export newest {target}")
    assert status == 2 and says in text and len(text.splitlines()) == 1


def test_a_full_stick_is_refused_before_copying(recorder: Guest, stick: pathlib.Path) -> None:
    names = on_stick(stick)
    recorder.wait_until(f"[ $(ls /rec/*.y4m | wc -l) -gt {STICK_MB // 8} ]")
    status, text = ctl(recorder, "export all usb")
    lines = text.splitlines()
    assert status == 1 and "nothing was copied" in lines[-2] and lines[-1].endswith("may be removed"), text
    assert on_stick(stick) == names


def test_a_flipped_bit_is_found(recorder: Guest, work: pathlib.Path) -> None:
    """In a frame of a recording on the machine."""
    before = save_counters(recorder)
    name = listed(recorder)[0]["files"][0]
    assert ctl(recorder, f"verify {name}")[0] == 0
    recorder.sh("sync")
    data = FileSystem(recorder.snapshot()).take(name, work / "original.y4m").read_bytes()
    _, frames = y4m.read(work / "original.y4m")
    at = data.index(b"\n") + 1
    for number, frame in enumerate(frames):
        at = data.index(b"\n", at) + 1 + len(frame.data)
        if number == 17:
            break
    byte = data[at - 1] ^ 16
    recorder.sh(f"printf '\\{byte:03o}' | dd of=/rec/{name} bs=1 seek={at - 1} conv=notrunc 2> /dev/null; sync")
    status, text = ctl(recorder, f"verify {name}")
    assert status == 1 and f"{name}: frame 17 is not what was recorded" in text
    back = data[at - 1]
    recorder.sh(f"printf '\\{back:03o}' | dd of=/rec/{name} bs=1 seek={at - 1} conv=notrunc 2> /dev/null; sync")
    assert ctl(recorder, f"verify {name}")[0] == 0
    assert save_counters(recorder).lost_total == before.lost_total


@pytest.mark.long
def test_an_update_from_the_stick(recorder: Guest, stick: pathlib.Path, root: pathlib.Path,
                                  tmp_path: pathlib.Path) -> None:
    """The other slot is written while the machine records."""
    new, file = slot_image.update(root, tmp_path)
    for name in on_stick(stick):
        run(["mdel", "-i", stick, f"::/{name}"])
    run(["mcopy", "-i", stick, file, "::/robot.update"])
    before = save_counters(recorder)
    status, text = recorder.shell().run("ddxctl update usb", 2 * PATIENCE)
    after = save_counters(recorder)
    assert (status, text.splitlines()) == (0, [
        f"slot B: version {slot_image.VERSION}; `ddxctl update start` restarts into it", "/dev/sda: may be removed"])
    assert after.lost_total == before.lost_total and after.out > before.out
    size = new.stat().st_size
    read = f"dd if=$(/usr/libexec/ddx/own-partition 3) bs=4096 count={size // 4096} 2> /dev/null | sha256sum"
    assert recorder.sh(read).split()[0] == run(["sha256sum", new]).split()[0]
    assert recorder.shell().run("grep -q /run/update /proc/mounts")[0] == 1
    run(["mdel", "-i", stick, "::/robot.update"])


def test_a_stick_that_is_pulled_out_is_reported(recorder: Guest, stick: pathlib.Path) -> None:
    """In one clear line; files with their final name on the stick are complete."""
    recorder.sh("mkdir -p /run/old && mount /dev/sda /run/old && rm -f /run/old/* && umount /run/old")
    newest = listed(recorder)[0]["files"][:4]
    recorder.sh(f"(ddxctl recordings export {' '.join(newest)} usb; echo status $?) > /run/said 2>&1 &")
    recorder.wait_until(f"grep -q {newest[0]}: /run/said")
    time.sleep(1)
    before = save_counters(recorder)
    recorder.monitor("device_del", id="stick")
    recorder.wait_until("grep -q status /run/said")
    said = recorder.sh("cat /run/said").splitlines()
    assert said[-1] == "status 1"
    wrong = [line for line in said if line.startswith("ddx")]
    assert len(wrong) == 1 and "was the stick pulled out?" in wrong[0], said
    assert not any("may be removed" in line for line in said)
    assert recorder.shell().run("grep -q export /proc/mounts")[0] == 1
    assert ctl(recorder, "export newest usb")[1] == "ddxctl: export: no USB stick is plugged in"
    left = [name for name in on_stick(stick) if name.endswith(".y4m")]
    assert newest[0] in left and len(left) < len(newest)
    for name in left:
        copy = subprocess.run(["mtype", "-i", stick, f"::/{name}"], capture_output=True, check=True).stdout
        assert len(copy) == int(recorder.sh(f"stat -c %s /rec/{name}"))
    time.sleep(2)
    after = save_counters(recorder)
    assert after.lost_total == before.lost_total and after.out > before.out
