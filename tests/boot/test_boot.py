# SPDX-License-Identifier: GPL-2.0-or-later
"""The boot of an intact machine, and its file systems."""
import pathlib
import re
import time

import pytest

from lib import evidence
from parts.common import PATIENCE
from parts.guest import session
from parts.guest.qemu import USERSPACE, Guest
from parts.media.recording import FileSystem
from parts.release import version

pytestmark = pytest.mark.retry


def test_boots_through_grub_from_slot_a(guest: Guest) -> None:
    words = guest.sh("cat /proc/cmdline").split()
    assert "BOOT_IMAGE=/boot/vmlinuz" in words and "ddx.loader=grub" in words and "ddx.slot=A" in words
    assert "root=PARTUUID=dd5601de-02" in words


def test_health_shows_the_running_version(guest: Guest, root: pathlib.Path) -> None:
    words = version.parse(guest.sh("cat /etc/os-release"))
    assert words == version.os_release(root) and words["ID"] == "ddxvideo"
    assert words["PRETTY_NAME"].encode() in guest.log.read_bytes()
    health = [line.split(maxsplit=1) for line in guest.sh("ddxctl health || true").splitlines() if line.strip()]
    assert ["version", words["VERSION"]] in health
    assert guest.sh("ddxvideosave -version").splitlines()[-1] == f"image: {words['VERSION']}"


def test_the_count_of_boots_is_cleared_once_one_is_up(closed: Guest) -> None:
    """GRUB counted this boot; the system removes the count."""
    closed.wait_for_log(USERSPACE)
    deadline = time.monotonic() + PATIENCE
    while closed.environment():
        assert time.monotonic() < deadline, closed.environment()
        time.sleep(1)


def test_output_that_is_read_late_arrives_whole(guest: Guest) -> None:
    """QEMU drops what the console has no room for, and the host's other work may delay a reader for a second."""
    console = guest.shell()
    console.begin("seq 1 20000")
    time.sleep(1)
    console.wait(re.escape("".join(f"{number}\n" for number in range(1, 20001)).encode()), 60)
    assert guest.sh("echo next").strip() == "next"


def test_root_is_a_read_only_squashfs(guest: Guest) -> None:
    assert [line for line in guest.sh("mount").splitlines() if " on / type squashfs (ro" in line]
    status, _ = guest.shell().run("touch /etc/x || touch /usr/x")
    assert status != 0


def test_kernel_is_6_12(guest: Guest) -> None:
    assert guest.sh("uname -r").startswith("6.12.")


def test_data_has_a_journal_and_recordings_have_none(guest: Guest) -> None:
    disk = guest.snapshot()
    assert "has_journal" not in FileSystem(disk, 6).features()
    assert "has_journal" in FileSystem(disk, 5).features()
    assert " on /rec type ext4 (rw" in guest.sh("mount")


def test_recordings_file_system_has_checksums_and_large_files(guest: Guest) -> None:
    assert {"metadata_csum", "flex_bg", "large_file"} <= set(FileSystem(guest.snapshot(), 6).features())


def test_nothing_can_be_written_below_an_empty_mount_point(guest: Guest) -> None:
    guest.sh("mkdir /tmp/bare && mount -o bind / /tmp/bare")  # the root without other mounts
    for folder in ["data", "rec", "test"]:
        assert guest.shell().run(f"touch /tmp/bare/{folder}/x")[0] != 0, folder
    guest.sh("umount /tmp/bare")


def test_data_and_recordings_are_mounted(guest: Guest) -> None:
    for folder in ["/data", "/rec"]:
        guest.sh(f"mountpoint -q {folder}")
    assert guest.sh("stat -c '%U %G %a' /rec") == "ddxsave ddx 2755"


def test_programs_run_from_data_and_from_memory(guest: Guest) -> None:
    """The places where docs/programs.md lets users try their own program."""
    for folder, runs in [("/data", True), ("/run", True), ("/tmp", True), ("/rec", False)]:
        guest.sh(f"cp /bin/busybox {folder}/uname")
        assert (guest.shell().run(f"{folder}/uname")[0] == 0) == runs, folder
        guest.sh(f"rm {folder}/uname")
    guest.sh("cp /bin/busybox /data/true && mount -o bind /data/true /usr/bin/ddxdecode")  # ddxdecode is off
    assert guest.sh("cmp /data/true /usr/bin/ddxdecode && echo same").strip() == "same"
    guest.sh("umount /usr/bin/ddxdecode && rm /data/true")


def test_late_work_comes_after_the_first_frame(guest: Guest) -> None:
    """Among it are the driver of the display, and the copy of the settings."""
    guest.wait_until("[ -e /run/late.done ]")
    first = session.follow(guest, 0)[session.LOAD].first_ns / 1e9
    assert first - 0.01 <= float(guest.sh("cat /run/late.begun")) < first + 60  # the kernel's time has two digits
    assert guest.sh("cat /run/log/late") == ""
    guest.sh("[ -e /sys/class/drm/card0 ] && [ -s /rec/.ddx/settings ]")


def test_no_start_has_failed(guest: Guest) -> None:
    for line in guest.sh("cat /run/log/boot").splitlines():
        begin, end, status, name, _ = line.split()
        assert status == "0", name
        print(f"{name}: {float(end) - float(begin):.2f} s")  # judged in test_budget.py


def test_a_failure_s_evidence_leaves_the_console_to_later_tests(guest: Guest) -> None:
    guest.sh(":")  # it runs
    for _ in range(2):
        assert evidence.take(guest, True).texts["dmesg"]
