# SPDX-License-Identifier: GPL-2.0-or-later
"""A technician's toggles take effect at once, and hold after a boot and in the next image. Runs the image's root on the
host's kernel; tests/boot/test_control.py uses the disk, both slots and a power cut."""
from __future__ import annotations

import json
import pathlib
import subprocess

import pytest

from parts.guest.native_machine import NativeMachine

pytestmark = pytest.mark.retry

SAVE, SEND, REAR = "ddxvideosave", "ddxvideosend", "ddxvideosend.rear"
Services = dict[str, dict[str, object]]


@pytest.fixture
def newer(root: pathlib.Path, tmp_path: pathlib.Path) -> pathlib.Path:
    """The root of another image with other default services and another bit rate."""
    subprocess.run(["cp", "-a", root, tmp_path / "newer"], check=True)
    for name, old, new in ((SAVE, "segment=256", "segment=64"), (SEND, "wire=400", "wire=321")):
        file = tmp_path / "newer/etc/default" / name
        assert file.read_text().count(f"{old}\n") == 1
        file.write_text(file.read_text().replace(old, new))
    return tmp_path / "newer"


def services(robot: NativeMachine) -> Services:
    found = [json.loads(line) for line in robot.sh("ddxctl services --json").splitlines()]
    return {one.pop("name"): one for one in found}


def runs(robot: NativeMachine, name: str) -> None:
    robot.wait_until(f"ddxctl status {name} | grep -q state=running")


def held(robot: NativeMachine) -> None:
    """Check that the toggles of the first boot still hold."""
    runs(robot, REAR)
    found = services(robot)
    assert found[SAVE]["enabled"] is False and found[SAVE]["state"] == "stopped"
    assert found[REAR]["enabled"] is True and "-bitrate 100" in command(robot, REAR)


def command(robot: NativeMachine, name: str) -> str:
    """The words with which the service's program was started. A service that runs is first the shell of its `run`, and
    programs that set its rights."""
    process = f"/proc/$(cat /run/service/{name}/supervise/pid)"
    robot.wait_until(f'[ "$(readlink {process}/exe)" = /usr/bin/{name.split(".")[0]} ]')
    return robot.sh(f"xargs -0 < {process}/cmdline")


def test_a_toggle_holds_now_after_a_boot_and_in_the_other_slot(root: pathlib.Path, newer: pathlib.Path,
                                                              tmp_path: pathlib.Path) -> None:
    keep = tmp_path / "disk"
    with NativeMachine(root, keep) as robot:
        runs(robot, SAVE)
        robot.sh(f"ddxctl disable {SAVE}")
        assert services(robot)[SAVE] == {"enabled": False, "state": "stopped", "pid": None, "restarts": 0}
        robot.sh(f"ddxctl add {REAR} name=rear port=8004 interface=lo bitrate=100")
        held(robot)
        robot.sh("reboot")
        robot.wait_for_end()
    with NativeMachine(root, keep) as robot:
        held(robot)
    with NativeMachine(newer, keep) as robot:
        held(robot)
        robot.sh(f"ddxctl enable {SAVE} && ddxctl enable {SEND} && ddxctl remove {REAR}")
        runs(robot, SAVE)
        runs(robot, SEND)
        assert "-segment 64" in command(robot, SAVE) and "-wire 321" in command(robot, SEND)
        assert REAR not in services(robot)


def test_names_of_services_before_release_0_3_0_hold(root: pathlib.Path, tmp_path: pathlib.Path) -> None:
    """A robot that is updated keeps its settings; the files keep their names, for an older image in the other slot."""
    (tmp_path / "data/ddx").mkdir(parents=True)
    for name, text in (("store", "m=16M\n"), ("decode", "enabled=yes\ninterface=lo\n"),
                       ("decode.rear", "enabled=yes\nname=rear\nport=8004\ninterface=lo\n")):
        (tmp_path / f"data/ddx/{name}.conf").write_text(text)
    with NativeMachine(root, tmp_path) as robot:
        assert "-m 16M" in command(robot, "ddxstore") and "-interface lo" in command(robot, "ddxdecode")
        assert "-instance ddxdecode.rear" in command(robot, "ddxdecode.rear")
        assert "decode" not in services(robot) and "decode.rear" not in services(robot)
        robot.sh("ddxctl disable decode")
        assert services(robot)["ddxdecode"]["enabled"] is False
        robot.sh("ddxctl remove decode.rear; ddxctl add decode.side name=side port=8008 interface=lo")
        runs(robot, "ddxdecode.side")
        assert robot.sh("cat /data/ddx/decode.conf") == "enabled=no\ninterface=lo"
        assert robot.sh("ls /data/ddx") == "ddxdecode.side.conf\ndecode.conf\nstore.conf"
        assert "decode.rear" not in str(services(robot))
        robot.sh("echo settings | ddxctl reset settings")
        assert robot.sh("ls /data/ddx") == ""
        robot.wait_until("ddxctl status store | grep -q state=running")
        assert "-m 32M" in command(robot, "ddxstore")


def test_a_service_without_its_file_fails_and_names_it(root: pathlib.Path, tmp_path: pathlib.Path) -> None:
    with NativeMachine(root, tmp_path) as robot:
        for word in ("enable", "start", "restart"):
            status, text = robot.run(f"ddxctl {word} ddxvideoload 2>&1")
            assert status == 1 and "does not start without its file /test/clip.y4m" in text, text
        assert "there is no /test/clip.y4m" in robot.sh("ddxctl logs ddxvideoload")


def test_a_disabled_service_is_not_started_and_the_way_is_named(root: pathlib.Path, tmp_path: pathlib.Path) -> None:
    with NativeMachine(root, tmp_path) as robot:
        robot.sh(f"ddxctl disable {SAVE}")
        for word in ("start", "restart"):
            status, text = robot.run(f"ddxctl {word} {SAVE} 2>&1")
            assert status == 1, text
            way = f"`ddxctl enable {SAVE}` starts it, also after each boot"
            assert text.splitlines()[-1] == f"ddxctl: {SAVE} is disabled; {way}"
        assert services(robot)[SAVE]["state"] == "stopped"


def test_health_complains_without_a_camera(root: pathlib.Path, tmp_path: pathlib.Path) -> None:
    with NativeMachine(root, tmp_path) as robot:
        runs(robot, "ddxvideoV4L")
        status, screen = robot.run("ddxctl health")
        assert status == 1
        assert "! camera     no picture from ddxvideoV4L: is the camera plugged in?" in screen
        robot.sh("ddxctl disable ddxvideoV4L")
        assert "! camera" not in robot.run("ddxctl health")[1]


def test_each_level_of_a_reset_asks_first_and_removes_its_part(root: pathlib.Path, tmp_path: pathlib.Path) -> None:
    with NativeMachine(root, tmp_path) as robot:
        robot.sh(f"ddxctl disable {SAVE}; ddxctl add {REAR} name=rear port=8004 interface=lo")
        robot.sh("echo kept > /rec/old.y4m; mkdir /data/ssh; echo secret > /data/ssh/key")
        runs(robot, "ddxstore")
        runs(robot, REAR)
        store = robot.sh("cat /run/service/ddxstore/supervise/pid")
        for typed in ("", "yes", "everything"):
            status, text = robot.run(f"echo {typed} | ddxctl reset settings")
            assert status == 1 and "not confirmed, nothing was changed" in text
        assert services(robot)[SAVE]["enabled"] is False
        robot.sh("echo settings | ddxctl reset settings")
        runs(robot, SAVE)
        assert services(robot)[SAVE]["enabled"] is True and REAR not in services(robot)
        files = "/run/service/ddxstore/supervise/pid /data/ssh/key /rec/old.y4m"
        assert robot.sh(f"cat {files}") == f"{store}\nsecret\nkept"
        assert "not confirmed" in robot.run("echo settings | ddxctl reset everything")[1]
        robot.sh(f"ddxctl disable {SAVE}")
        robot.run("echo everything | ddxctl reset everything")
        robot.wait_for_end()
    with NativeMachine(root, tmp_path) as robot:
        runs(robot, SAVE)
        assert robot.sh("cat /rec/old.y4m; ls -A /data /data/ddx") == "kept\n/data:\nddx\n\n/data/ddx:"
        robot.run("echo everything | ddxctl reset everything recordings")
        robot.wait_for_end()
    assert list((tmp_path / "rec").glob("*.y4m")) == []
