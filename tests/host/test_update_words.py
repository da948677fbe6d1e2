# SPDX-License-Identifier: GPL-2.0-or-later
"""The words of `ddxctl update`: what it passes to ddxupdate, and when it restarts the machine.
tests/boot/test_update.py has the whole on a machine."""
from __future__ import annotations

import functools
import http.server
import pathlib
import threading
from collections.abc import Iterator

import pytest

from parts.common import run
from parts.disk.logged_device import lacking

from .appliance import Appliance

pytestmark = pytest.mark.retry


@pytest.fixture(name="robot", scope="module")
def _robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Appliance]:
    appliance = Appliance(tmp_path_factory.mktemp("words"))
    appliance.install("package/ddxupdate/ctl-update", "usr/libexec/ddx/ctl-update")
    appliance.add("usr/libexec/ddx/own-partition", '#!/bin/sh\n[ ! -e /run/none ] && echo "/dev/own$1"\n')
    appliance.add("usr/libexec/ddx/ddxupdate",
                  '#!/bin/sh\n{ echo "$*"; cat; } > /run/words\ngrep " /run/update" /proc/mounts > /run/mounts\n'
                  'exit "$(cat /run/status)"\n')
    appliance.install("package/ddxservice/stick", "usr/libexec/ddx/stick")
    (appliance.root / "sbin/reboot").unlink()  # a link to BusyBox
    appliance.add("sbin/reboot", "#!/bin/sh\necho restart >> /run/words\n")
    appliance.add("usr/libexec/ddx/control", "#!/bin/sh\necho thing\n")
    appliance.add("usr/libexec/ddx/settings-copy", "#!/bin/sh\necho settings\n")
    (appliance.root / "data").mkdir()
    (appliance.root / "run/file").write_text("content\n")
    yield appliance
    appliance.end()


def words(robot: Appliance, command: str, status: int = 0) -> tuple[int, str, str]:
    """Exit status, output, and what was called."""
    called = robot.root / "run/words"
    called.unlink(missing_ok=True)
    (robot.root / "run/status").write_text(f"{status}\n")
    code, said = robot.run(f"{command} < /dev/null")
    return code, said, called.read_text() if called.exists() else ""


DEVICES = "/dev/own1 /dev/own2 /dev/own3\n"


@pytest.mark.parametrize("typed, status, called", [
    ("/run/file", 0, f"write {DEVICES}content\n"),
    ("/run/file -older", 2, f"write -older {DEVICES}content\n"),
    ("-", 0, f"write {DEVICES}"),
    ("--older -", 1, f"write -older {DEVICES}"),
    ("start", 0, f"start {DEVICES}restart\n"),
    ("start -older", 0, f"start -older {DEVICES}restart\n"),
    ("start", 2, f"start {DEVICES}"),
    ("back", 0, f"back {DEVICES}restart\n"),
    ("back", 1, f"back {DEVICES}"),
    ("seen", 0, "seen /dev/own1\n"),
    ("keep", 2, "keep /dev/own1\n"),
    ("status", 0, f"status {DEVICES}"),
    ("status --json", 0, f"status -json {DEVICES}"),
])
def test_words(robot: Appliance, typed: str, status: int, called: str) -> None:
    assert words(robot, f"/usr/libexec/ddx/ctl-update {typed}", status) == (status, "", called)


@pytest.mark.parametrize("typed, said", [
    ("", "needs a file, -, usb, start, status, keep, back, report or seen"),
    ("/run/none", "/run/none: there is no such file"),
    ("start back", "unexpected 'back'"),
    ("report", "no version was taken back on this machine"),
    ("-x", "unknown option -x"),
    ("start -json", "-json belongs to status"),
    ("https://example.org/x.update", "an update is not read from there"),
    ("usb", "no USB stick is plugged in"),
    ("/dev/none", "/dev/none: there is no such device"),
])
def test_bad_words(robot: Appliance, typed: str, said: str) -> None:
    code, text, called = words(robot, f"/usr/libexec/ddx/ctl-update {typed}")
    assert (code, called) == (2, "") and text.startswith("ddxctl: update: ") and said in text and text.count("\n") == 1


def test_the_machine_is_noted_before_a_trial_only(robot: Appliance) -> None:
    noted = robot.root / "run/update.services", robot.root / "data/update.settings"
    for path in noted:
        path.unlink(missing_ok=True)
    (robot.root / "run/update.trial").write_text("all well for 1 of 300 s\n")
    words(robot, "/usr/libexec/ddx/ctl-update back")
    assert not any(path.exists() for path in noted)
    (robot.root / "run/update.trial").unlink()
    words(robot, "/usr/libexec/ddx/ctl-update start")
    assert [path.read_text() for path in noted] == ["thing\n", "settings\n"]
    assert noted[1].stat().st_mode & 0o777 == 0o600


def test_another_disk(robot: Appliance) -> None:
    (robot.root / "run/none").touch()
    code, text, called = words(robot, "/usr/libexec/ddx/ctl-update start")
    (robot.root / "run/none").unlink()
    assert (code, text, called) == (2, "ddxctl: update: this disk does not have the appliance's partitions\n", "")


class Pages(http.server.SimpleHTTPRequestHandler):
    users: list[int] = []

    def do_GET(self) -> None:
        """Notes whose socket asks: /proc/net/tcp has it in hexadecimal digits, with its user."""
        port = f":{self.client_address[1]:04X}"
        sockets = [line.split() for line in pathlib.Path("/proc/net/tcp").read_text().splitlines()]
        self.users.extend(int(one[7]) for one in sockets if one[1].endswith(port))
        super().do_GET()

    def log_message(self, *_: object) -> None:
        pass


def test_an_update_is_fetched_by_a_user_without_rights(robot: Appliance) -> None:
    pages = functools.partial(Pages, directory=robot.root / "run")
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), pages) as web:
        threading.Thread(target=web.serve_forever, daemon=True).start()
        fetch = f"/usr/libexec/ddx/ctl-update http://127.0.0.1:{web.server_port}"
        assert words(robot, f"{fetch}/file -older") == (0, "", f"write -older {DEVICES}content\n")
        code, said, called = words(robot, f"{fetch}/nothing", 2)
        web.shutdown()
    assert (code, called) == (2, f"write {DEVICES}") and "404" in said
    assert Pages.users == [65534, 65534]


class Sticks:
    """Loop devices that look like disks at USB."""

    def __init__(self, robot: Appliance, folder: pathlib.Path) -> None:
        self.robot, self.folder, self.devices = robot, folder, list[str]()
        for name in ("block", "class/block", "devices/usb1"):
            (robot.root / "sys" / name).mkdir(parents=True, exist_ok=True)

    def plug(self, names: str = "", label: str = "") -> str:
        """Names of files, of folders (with / at the end) and of links (with @); each file has the word `content`."""
        number = len(self.devices)
        files, image = self.folder / f"files{number}", self.folder / f"stick{number}.img"
        files.mkdir()
        for name in names.split():
            path = files / name.strip("/@")
            if name.endswith("/"):
                path.mkdir()
            elif name.endswith("@"):
                path.symlink_to("/etc/passwd")
            else:
                path.write_text("content\n")
        run(["mke2fs", "-q", "-t", "ext4", "-d", files, "-L", label, image, "1M"])
        device = run(["losetup", "--find", "--show", image]).strip()
        self.devices.append(device)
        name = device.removeprefix("/dev/")
        (self.robot.root / "sys/devices/usb1" / name).mkdir()
        for folder in ("block", "class/block"):
            (self.robot.root / "sys" / folder / name).symlink_to(f"/sys/devices/usb1/{name}")
        return device

    def end(self) -> None:
        for device in self.devices:
            run(["losetup", "--detach", device])
            for folder in ("block", "class/block"):
                (self.robot.root / "sys" / folder / device.removeprefix("/dev/")).unlink()
            (self.robot.root / "sys/devices/usb1" / device.removeprefix("/dev/")).rmdir()


@pytest.fixture(name="sticks")
def _sticks(robot: Appliance, tmp_path: pathlib.Path) -> Iterator[Sticks]:
    if reason := lacking():
        pytest.skip(reason)
    sticks = Sticks(robot, tmp_path)
    yield sticks
    left = list((robot.root / "run").glob("update.[0-9]*")), robot.run("grep /run/update /proc/mounts")
    sticks.end()
    assert left == ([], (1, ""))


@pytest.mark.parametrize("typed, status", [("usb", 0), ("usb -older", 0), ("usb", 1), ("DEVICE", 0)])
def test_an_update_from_a_stick(robot: Appliance, sticks: Sticks, typed: str, status: int) -> None:
    """Mounted for reading alone; no program or device on it is of use."""
    device = sticks.plug("robot.update other link.update@ folder.update/ .hidden.update")
    older = "-older " if "older" in typed else ""
    typed = typed.replace("DEVICE", device)
    assert words(robot, f"/usr/libexec/ddx/ctl-update {typed}", status) == (
        status, f"{device}: may be removed\n", f"write {older}{DEVICES}content\n")
    options = (robot.root / "run/mounts").read_text().split()[3].split(",")
    assert {"ro", "noexec", "nosuid", "nodev"} <= set(options)


@pytest.mark.parametrize("names, label, said", [
    ("update link.update@ folder.update/", "", "has no file *.update in its top folder"),
    ("a.update b.update", "", "has 2 files *.update in its top folder; remove all but one"),
    ("a.update", "DDXREC", "no USB stick is plugged in"),
    ("none a.update", "", "this disk does not have the appliance's partitions"),
])
def test_a_stick_that_is_refused(robot: Appliance, sticks: Sticks, names: str, label: str, said: str) -> None:
    device = sticks.plug(names, label)
    if "none" in names:
        (robot.root / "run/none").touch()
    code, text, called = words(robot, "/usr/libexec/ddx/ctl-update usb")
    (robot.root / "run/none").unlink(missing_ok=True)
    assert (code, called) == (2, "") and text.startswith("ddxctl: update: ") and said in text
    assert text.replace(f"{device}: may be removed\n", "").count("\n") == 1


def test_one_of_two_sticks(robot: Appliance, sticks: Sticks) -> None:
    first, second = sticks.plug("a.update"), sticks.plug("b.update")
    code, text, called = words(robot, "/usr/libexec/ddx/ctl-update usb")
    assert (code, called) == (2, "") and "there are several sticks" in text
    for device in (first, second):
        assert words(robot, f"/usr/libexec/ddx/ctl-update {device}")[0] == 0
