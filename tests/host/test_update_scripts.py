# SPDX-License-Identifier: GPL-2.0-or-later
"""The scripts around a trial: a version is taken back also when the trial itself fails, and settings that only the
newer version knows do not stay."""
from __future__ import annotations

import pathlib
from collections.abc import Iterator

import pytest

from parts.disk.logged_device import lacking
from parts.image import native

from .appliance import Appliance, with_service
from .update_disk import UpdateDisk

pytestmark = pytest.mark.retry

PROGRAM = "usr/libexec/ddx/ddxupdate"
# A program that knows only the options of an older version.
THING = """#!/bin/sh
for word; do
	case "$word" in
		-rate|-check|-instance|thing.*|[0-9]*) ;;
		*) echo "unknown option '$word'"; exit 2 ;;
	esac
done
"""
OLD = "enabled=yes\nrate=5\n"
NEW = "enabled=yes\nrate=5\nsharpness=3\n"
OTHER = "enabled=yes\nrate=6\n"


class Robot:
    """An appliance with a disk, whose slot B runs. `ddxctl report` and the restart leave files in /run."""

    def __init__(self, robot: Appliance, disk: UpdateDisk) -> None:
        self.robot, self.disk, self.root = robot, disk, robot.root
        for name in ("slot-came-up", "settings-copy", "restore.awk"):
            robot.install(f"overlay/usr/libexec/ddx/{name}", f"usr/libexec/ddx/{name}")
        robot.install("overlay/etc/init.d/S16update", "etc/init.d/S16update")
        robot.install_program(native.build() / PROGRAM, PROGRAM)
        boot, a, b = disk.devices
        robot.add("usr/libexec/ddx/own-partition", f"#!/bin/sh\nset {boot} {a} {b} $1\nshift $(($4 - 1))\necho $1\n")
        robot.add("usr/libexec/ddx/control", "#!/bin/sh\necho thing enabled=yes state=running pid=2 restarts=0\n")
        robot.add("usr/libexec/ddx/report", "#!/bin/sh\necho everything\n")
        (self.root / "sbin/reboot").unlink()  # a link to BusyBox
        robot.add("sbin/reboot", "#!/bin/sh\ntouch /run/restarted\n")
        robot.add("usr/bin/thing", THING)
        robot.add("etc/default/thing", "user=root\nenabled=no\n")
        robot.add("etc/os-release", 'VARIANT_ID=test\nVERSION="0.3.0"\n')
        robot.add("etc/ddx/trial", "good=1000\ndeadline=0.3\nstep=0.1\n")
        for name in ("data/ddx", "rec"):
            (self.root / name).mkdir(parents=True)
        self.remember("tried=B\nversion=0.3.0\nresult=begun\nreason=\nruns=thing\n")
        self.words("ddx.slot=B ddx.layout=1 ddx.counted=left=2")

    def words(self, text: str) -> None:
        (self.root / "run/words").write_text(f"root=x {text}\n")
        assert self.robot.run("mount -o bind /run/words /proc/cmdline") == (0, "")

    def remember(self, text: str) -> None:
        (self.root / "data/update").write_text(text)

    def remembered(self, name: str) -> str:
        lines = (self.root / "data/update").read_text().splitlines()
        return dict(line.split("=", 1) for line in lines)[name]

    def settings(self) -> dict[str, str]:
        return {path.name: path.read_text() for path in (self.root / "data/ddx").iterdir()}


@pytest.fixture(name="robot")
def _robot(tmp_path: pathlib.Path) -> Iterator[Robot]:
    if reason := lacking():
        pytest.skip(reason)
    with UpdateDisk(tmp_path, "B", block={"slot": "B", "left": "2"}) as disk, with_service(tmp_path) as appliance:
        yield Robot(appliance, disk)


CRASHES = '#!/bin/sh\n[ "$1" != trial ] || kill -SEGV $$\nexec /usr/libexec/ddx/real "$@"\n'


@pytest.mark.parametrize("words, crashes, reason", [
    ("left=2", False, "thing does not run"),
    ("left=2", True, "its trial failed (exit status 139)"),
    ("left=1", False, "the boot loader has not counted this boot, so a slot that cannot be booted may stay the chosen "
     "one; flash another card")], ids=["bad", "trial-crashes", "not-counted"])
def test_a_version_is_taken_back(robot: Robot, words: str, crashes: bool, reason: str) -> None:
    robot.words(f"ddx.slot=B ddx.layout=1 ddx.counted={words}")
    if crashes:
        (robot.root / PROGRAM).rename(robot.root / "usr/libexec/ddx/real")
        robot.robot.add(PROGRAM, CRASHES)
    robot.robot.run("/usr/libexec/ddx/slot-came-up")
    assert robot.disk.block() == {"failed": "B"} and robot.remembered("reason") == reason
    assert (robot.root / "data/update.report").read_text() == "everything\n"
    assert (robot.root / "run/restarted").exists()


@pytest.mark.parametrize("words, restarts", [("left=2", True), ("begun=1", False)])
def test_a_version_without_ddxupdate(robot: Robot, words: str, restarts: bool) -> None:
    """The boot loader counts on; a version that was kept before stays."""
    robot.words(f"ddx.slot=B ddx.layout=1 ddx.counted={words}")
    (robot.root / PROGRAM).unlink()
    robot.robot.run("/usr/libexec/ddx/slot-came-up")
    assert (robot.root / "run/restarted").exists() == restarts
    assert (robot.root / "run/slot.wrong").read_text().startswith("ddxupdate fails, so ")


def test_settings_that_only_the_newer_version_knows(robot: Robot) -> None:
    folder = robot.root / "data/ddx"
    for name, text in {"thing": OLD, "thing.a": OLD, "thing.c": NEW, "stranger": NEW}.items():
        (folder / f"{name}.conf").write_text(text)
    assert robot.robot.run("/usr/libexec/ddx/settings-copy contents > /data/update.settings") == (0, "")
    for name, text in {"thing": NEW, "thing.a": OTHER, "thing.b": NEW}.items():
        (folder / f"{name}.conf").write_text(text)
    robot.disk.set_block({"begun": "1", "failed": "B"})
    robot.words("ddx.slot=A ddx.layout=1 ddx.counted=begun=1")
    robot.remember("tried=B\nversion=0.3.0\nresult=begun\nreason=thing does not run\n")
    assert robot.robot.run("/etc/init.d/S16update start") == (0, "Starting update: OK\n")
    assert robot.settings() == {
        "thing.conf": OLD, "thing.conf.refused": NEW, "thing.a.conf": OTHER, "thing.b.conf.refused": NEW,
        "thing.c.conf": NEW, "stranger.conf": NEW}
    assert robot.remembered("result") == "returned"
    assert robot.remembered("reason") == "thing does not run; replaced settings: thing.b thing"
    # Once: the next boot leaves the settings as they are.
    (folder / "thing.conf").write_text(NEW)
    assert robot.robot.run("/etc/init.d/S16update start") == (0, "Starting update: OK\n")
    assert robot.settings()["thing.conf"] == NEW


def test_other_boots_change_nothing(robot: Robot) -> None:
    (robot.root / "data/ddx/thing.conf").write_text(NEW)
    for words in ("ddx.slot=B ddx.layout=1 ddx.counted=begun=1", "ddx.slot=A ddx.rescue ddx.counted=begun=1"):
        robot.words(words)
        assert robot.robot.run("/etc/init.d/S16update start")[0] == 0
    assert robot.settings() == {"thing.conf": NEW} and robot.remembered("result") == "begun"
