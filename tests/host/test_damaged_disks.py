# SPDX-License-Identifier: GPL-2.0-or-later
"""Damaged file systems on loop devices, with the image's scripts, BusyBox and e2fsck: damage is repaired or reported,
settings have a second copy, and only the recorder waits."""
from __future__ import annotations

import os
import pathlib
import shutil
import subprocess
from collections.abc import Iterator

import pytest
from parts.common import SBIN, run
from parts.guest.slow_disk import FILE_SYSTEMS

from .appliance import Appliance
from .programs import wait_until

pytestmark = pytest.mark.retry

SCRIPTS = {f"overlay/usr/libexec/ddx/{name}": f"usr/libexec/ddx/{name}"
           for name in ("storage", "recordings-disk", "settings-copy", "restore.awk", "disk", "init-action")}
SCRIPTS["overlay/etc/init.d/S15storage"] = "etc/init.d/S15storage"
SIZES = {"DDXDATA": "32M", "DDXREC": "160M"}  # several groups, so that there is a second superblock
# As in board/common/disk.cfg.
OPTIONS = {"DDXDATA": ["-b", "1024", *FILE_SYSTEMS["ext4-journal"]], "DDXREC": ["-i", "1048576", *FILE_SYSTEMS["ext4"]]}
MIB = 1 << 20
ENVIRONMENT = {**os.environ, **SBIN}


class Robot(Appliance):
    def __init__(self, folder: pathlib.Path) -> None:
        super().__init__(folder)
        self.files = folder
        self.devices: dict[str, str] = {}
        self.install_service()
        for script, to in SCRIPTS.items():
            self.install(script, to)
        modules = f"lib/modules/{os.uname().release}"
        for name in ("data", "rec", "test", "mnt", "run/settings", modules):
            (self.root / name).mkdir(parents=True)
        (self.root / modules / "modules.dep").touch()
        for name in ("run/provision", "run/console", "run/late.begun"):
            (self.root / name).touch()
        assert self.run("mount --bind /run/console /dev/console")[0] == 0
        with (self.root / "etc/passwd").open("a") as users:
            users.write("ddxsave:x:903:900::/:/bin/sh\nddxlogger:x:909:900::/:/bin/sh\n")
        checker = shutil.which("e2fsck", path=SBIN["PATH"])
        assert checker
        self.install_program(pathlib.Path(checker), checker.lstrip("/"))
        self.add("usr/libexec/ddx/serial", "#!/bin/sh\nexec cat\n")
        self.add("usr/libexec/ddx/grow", "#!/bin/sh\necho 'ddxgrow: done'\n")
        for label in SIZES:
            self.devices[label] = self.disk(label)
        self.add("usr/libexec/ddx/own-partition", "#!/bin/sh\ncase $1 in\n5) echo {DDXDATA} ;;\n6) echo {DDXREC} ;;\n"
                                                  "esac\n".format(**self.devices))

    def disk(self, label: str, name: str = "") -> str:
        """Make a disk with a file on it."""
        image = self.files / f"{name or label}.img"
        run(["truncate", "-s", SIZES[label], image])
        run(["mke2fs", "-q", *OPTIONS[label], "-m", "0", "-L", label, image])
        (self.files / "kept").write_text("kept\n")
        run(["debugfs", "-w", "-R", f"write {self.files}/kept kept", image])
        return run(["losetup", "--find", "--show", image]).strip()

    def spoil(self, label: str, begin: int, length: int) -> None:
        with open(self.devices[label], "r+b") as disk:
            disk.seek(begin)
            disk.write(bytes(length))

    def boot(self) -> tuple[int, str]:
        return self.run("/etc/init.d/S15storage start")

    def handle_recordings(self) -> None:
        """Run the job that init runs for the recordings' disk."""
        self.start("exec /usr/libexec/ddx/recordings-disk")

    def disk_report(self) -> str:
        log = self.root / "run/log/recordings-disk"
        return (log.read_text().splitlines() or [""])[-1] if log.exists() else ""

    def mounted(self, folder: str) -> bool:
        return self.run(f"mountpoint -q {folder}")[0] == 0

    def write_settings(self) -> None:
        """Switch a service off in the settings and in their copy."""
        self.run("mount -t ext4 {DDXDATA} /data && mount -t ext4 {DDXREC} /rec && mkdir /data/ddx && "
                 "echo enabled=no > /data/ddx/thing.conf && echo rate=5 > /data/ddx/thing.b.conf && "
                 "/usr/libexec/ddx/settings-copy save && umount /data /rec".format(**self.devices))

    def end(self) -> None:
        super().end()
        for device in self.devices.values():
            subprocess.run(["losetup", "--detach", device], env=ENVIRONMENT, check=False)


@pytest.fixture
def robot(tmp_path: pathlib.Path) -> Iterator[Robot]:
    if os.geteuid() != 0 or subprocess.run(["losetup", "-f"], env=ENVIRONMENT, capture_output=True,
                                           check=False).returncode:
        pytest.skip("needs root and loop devices")
    robot = Robot(tmp_path)
    yield robot
    robot.end()


def test_both_disks_are_mounted_with_the_right_owners(robot: Robot) -> None:
    assert robot.boot() == (0, "Starting storage: OK\n")
    wait_until(lambda: robot.run("cat /run/log/ddxgrow")[1] == "ddxgrow: done\n")  # the last step
    assert robot.disk_report() == f"{robot.devices['DDXREC']} is there"
    assert robot.run("cat /data/kept /rec/kept; stat -c '%U %a' /rec /rec/log") == (
        0, "kept\nkept\nddxsave 2755\nddxlogger 2755\n")
    assert robot.run("grep -c errors=remount-ro /proc/mounts")[1] == "2\n"
    assert not (robot.root / "run/settings.lost").exists() and not (robot.root / "run/console").read_text()


@pytest.mark.parametrize("begin, length, kept", [(1024, 1024, True), (0, MIB, False)], ids=["superblock", "MiB"])
def test_damaged_recordings_are_repaired_and_reported(robot: Robot, begin: int, length: int, kept: bool) -> None:
    robot.spoil("DDXREC", begin, length)
    assert robot.boot() == (0, "Starting storage: OK\n")
    report = (f"{robot.devices['DDXREC']} is there, after a repair that may have cost recordings; "
            "see /run/log/check.DDXREC")
    wait_until(lambda: robot.disk_report() == report)
    assert robot.mounted("/rec") and (robot.run("cat /rec/kept")[1] == "kept\n") == kept
    wait_until(lambda: (robot.root / "run/console").read_text() == f"DDXVIDEO: {report}\n")


def test_unrepairable_recordings_are_reported_once_and_another_disk_is_used(robot: Robot) -> None:
    robot.spoil("DDXREC", 0, 160 * MIB)
    assert robot.boot() == (0, "Starting storage: OK\n")
    robot.handle_recordings()
    broken = robot.devices["DDXREC"]
    report = f"{broken}, the recordings' disk, cannot be used: nothing is recorded; see /run/log/check.DDXREC"
    log = robot.root / "run/log/recordings-disk"
    wait_until(lambda: log.exists() and log.read_text().count(report) == 2)  # by the boot, and by the job afterwards
    assert not robot.mounted("/rec")
    robot.devices["other"] = robot.disk("DDXREC", "other")
    name = robot.devices["other"].removeprefix("/dev/")
    robot.run(f"ACTION=add MDEV={name} /usr/libexec/ddx/disk")
    wait_until(lambda: robot.disk_report() == f"/dev/{name} is there")
    assert robot.run("cat /rec/kept")[1] == "kept\n"
    robot.run(f"ACTION=remove MDEV={name} /usr/libexec/ddx/disk")
    assert not robot.mounted("/rec")
    robot.run(f"ACTION=add MDEV={name} /usr/libexec/ddx/disk")  # plugged in again
    wait_until(lambda: robot.mounted("/rec"))


def test_other_disks_are_left_alone(robot: Robot) -> None:
    robot.spoil("DDXREC", 0, 160 * MIB)
    robot.boot()
    robot.handle_recordings()
    for name in (robot.devices["DDXDATA"], "/dev/loop-there-is-none", "/dev/null"):
        robot.run(f"ACTION=add MDEV={name.removeprefix('/dev/')} /usr/libexec/ddx/disk")
    robot.devices["other"] = robot.disk("DDXREC", "other")
    robot.run(f"ACTION=add MDEV={robot.devices['other'].removeprefix('/dev/')} /usr/libexec/ddx/disk")
    wait_until(lambda: robot.mounted("/rec"))
    log = (robot.root / "run/log/recordings-disk").read_text()
    assert robot.devices["DDXDATA"] not in log and "none" not in log


def test_only_the_recorder_waits_for_a_long_check(robot: Robot) -> None:
    os.mkfifo(robot.root / "run/patience")
    real = robot.run("command -v e2fsck")[1].strip()
    shutil.move(robot.root / real.lstrip("/"), robot.root / "bin/e2fsck.real")
    robot.add(real.lstrip("/"), f"#!/bin/sh\ncase \"$*\" in *{robot.devices['DDXREC']}*) cat /run/patience ;; esac\n"
                                'exec /bin/e2fsck.real "$@"\n')
    robot.add("usr/bin/thing", "#!/bin/sh\nexec sleep 1000\n")
    (robot.root / "etc/default/thing").write_text("user=root\nmounted=/rec\n")
    assert robot.boot() == (0, "Starting storage: OK\n")  # at once
    robot.run("/usr/libexec/ddx/service thing start")
    robot.start("exec runsvdir -P /run/service")

    def state() -> str:
        return robot.run("/usr/libexec/ddx/service thing status")[1].split()[2]
    wait_until(lambda: state() == "state=waiting")
    assert robot.disk_report() == f"{robot.devices['DDXREC']} is being checked" and not robot.mounted("/rec")
    with (robot.root / "run/patience").open("w"):
        pass
    wait_until(lambda: state() == "state=running")
    assert robot.mounted("/rec")
    assert robot.run("/usr/libexec/ddx/service thing stop")[1] == "Stopping thing: OK\n"
    robot.run("umount /rec && /usr/libexec/ddx/service thing start")
    wait_until(lambda: state() == "state=waiting")
    # a waiting service can be stopped
    assert robot.run("/usr/libexec/ddx/service thing stop")[1] == "Stopping thing: OK\n"
    assert state() == "state=stopped"


def test_at_the_boot_settings_are_copied_and_the_disk_grows_after_the_first_frame(robot: Robot) -> None:
    (robot.root / "run/late.begun").unlink()
    robot.install("overlay/usr/libexec/ddx/late", "usr/libexec/ddx/late")
    robot.add("usr/libexec/ddx/lastboot", "#!/bin/sh\n[ ! -e /rec/.ddx ] || touch /run/early\n")
    os.mkfifo(robot.root / "run/late")
    robot.boot()
    wait_until(lambda: robot.disk_report().endswith("is there"))
    wait_until(lambda: robot.run("flock -n /run/recordings-disk.lock true")[0] == 0)  # its script has exited
    robot.start("/usr/libexec/ddx/late")
    with (robot.root / "run/late").open("w") as pipe:
        pipe.write("\n")
    wait_until((robot.root / "run/late.done").exists)
    assert not (robot.root / "run/early").exists()
    assert robot.run("cat /run/log/ddxgrow; ls /rec/.ddx") == (0, "ddxgrow: done\nsettings\n")


LOST = {"copy": "settings are those of their copy on /rec",
        "none": "there is no copy on /rec; settings are the image's, and forgotten at the next boot"}


@pytest.mark.parametrize("copy", LOST)
def test_settings_beyond_repair_come_from_their_copy(robot: Robot, copy: str) -> None:
    if copy == "copy":
        robot.write_settings()
    robot.spoil("DDXDATA", 0, 32 * MIB)
    assert robot.boot() == (1, "Starting storage: FAIL: data\n")
    assert LOST[copy] in (robot.root / "run/settings.lost").read_text()
    wait_until(lambda: robot.mounted("/rec"))  # independent of the settings
    found = robot.run("cat /data/ddx/thing.conf /data/ddx/thing.b.conf")[1]
    assert (found == "enabled=no\nrate=5\n") == (copy == "copy")


def test_settings_made_without_their_disk_are_kept(robot: Robot) -> None:
    """They are saved in the copy, which the next boot uses."""
    robot.spoil("DDXDATA", 0, 32 * MIB)
    robot.boot()
    wait_until(lambda: robot.disk_report().endswith("is there"))
    robot.run("echo enabled=no > /data/ddx/thing.conf && /usr/libexec/ddx/settings-copy save")
    assert robot.run("/etc/init.d/S15storage stop")[1] == "Stopping storage: OK\n"
    robot.boot()
    assert robot.run("cat /data/ddx/thing.conf")[1] == "enabled=no\n"


def test_after_a_repair_the_settings_come_from_the_copy(robot: Robot) -> None:
    robot.write_settings()
    robot.run("mount -t ext4 {DDXDATA} /data && echo enabled=maybe > /data/ddx/thing.conf && "
              "touch /data/ddx/other.conf && umount /data".format(**robot.devices))
    robot.spoil("DDXDATA", 1024, 1024)
    assert robot.boot() == (0, "Starting storage: OK\n")
    assert (robot.root / "run/settings.lost").read_text() == f"/data had to be repaired; {LOST['copy']}\n"
    assert robot.run("cd /data/ddx && ls && cat thing.conf /data/kept")[1] == (
        "thing.b.conf\nthing.conf\nenabled=no\nkept\n")


def test_programs_that_use_a_disk_are_killed_before_it_is_unmounted(robot: Robot) -> None:
    robot.boot()
    wait_until(lambda: robot.disk_report().endswith("is there"))
    holders = [robot.start("cd /rec && exec sleep 1000"),
               robot.start("cd /data && trap '' TERM; echo ready > /data/ready; while :; do sleep 1; done")]
    wait_until(lambda: robot.run("[ -e /data/ready ] && fuser -m /rec")[0] == 0)
    assert robot.run("/etc/init.d/S15storage stop") == (0, "Stopping storage: OK\n")
    for holder in holders:
        holder.wait(10)
    assert not robot.mounted("/rec") and not robot.mounted("/data")
    assert "clean" in run(["e2fsck", "-n", robot.devices["DDXREC"]])
