# SPDX-License-Identifier: GPL-2.0-or-later
"""Folders of services that the image's build makes ready are those that a boot would write, and only services without
settings get them."""
from __future__ import annotations

import pathlib
import shutil
from collections.abc import Iterator

import pytest

from parts.common import TOP, run

from .appliance import Appliance, with_service

pytestmark = pytest.mark.retry

DEFAULTS = {"ddxstore": "enabled=yes\nuser=ddxlog\npriority=-10\nm=32M\n",
            "thing": "enabled=yes\nuser=ddxlog\nonce=yes\nmounted=/rec\nargument=it's `two words`\n",
            "off": "enabled=no\nuser=ddxlog\n",
            "clip": "enabled=yes\nuser=ddxlog\nneeds=/test/clip\n",
            "own": "enabled=yes\nuser=ddxlog\n"}  # has a script of its own
READY = "/etc/init.d/S19ready start"
LISTING = "cd /run && find service log -exec stat -c '%N %a %U %G %F %s' {} + | sort && " \
          "find service log -type f -exec md5sum {} + | sort"


def build(appliance: Appliance) -> None:
    run([TOP / "board/common/post-build.sh", appliance.root])


@pytest.fixture
def appliance(tmp_path: pathlib.Path) -> Iterator[Appliance]:
    """An image as built; no program runs in it."""
    with with_service(tmp_path) as appliance:
        for name, text in DEFAULTS.items():
            (appliance.root / "etc/default" / name).write_text(text)
        package = tmp_path / "package"
        (package / "own").mkdir(parents=True)
        (package / "own/S54own").write_text("")
        (package / "programs.txt").write_text("".join(
            f"{'own' if name == 'own' else '.'} S5{number}{name} {name} 95{number} a test\n"
            for number, name in enumerate(DEFAULTS)))
        run([TOP / "board/common/init-scripts", package, appliance.root])
        appliance.add("etc/init.d/S54own", "#!/bin/sh\n/usr/libexec/ddx/service own start\n")
        appliance.install("overlay/etc/init.d/S19ready", "etc/init.d/S19ready")
        rcs = (TOP / "overlay/etc/init.d/rcS").read_text()
        assert "sleep 5" in rcs  # of the guard, which keeps the output open
        appliance.add("etc/init.d/rcS", rcs.replace("sleep 5", "sleep 0.1"))
        appliance.add("usr/libexec/ddx/serial", "#!/bin/sh\nexec cat\n")
        for name in ("slot-came-up", "late"):
            appliance.add(f"usr/libexec/ddx/{name}", "#!/bin/sh\n")
        build(appliance)
        yield appliance


def folders(appliance: Appliance) -> list[str]:
    return sorted(path.name for path in (appliance.root / "run/service").iterdir())


def launch(appliance: Appliance, name: str) -> str:
    return (appliance.root / f"run/service/{name}/launch").read_text()


def boot(appliance: Appliance) -> str:
    """The output of all scripts, without the version."""
    code, text = appliance.run("rm -f /run/log/boot; /etc/init.d/rcS")
    version, _, said = text.partition("\n")
    assert code == 0 and version.startswith("DDXVIDEO "), text
    return said


def test_ready_folders_are_those_that_a_start_writes(appliance: Appliance) -> None:
    assert appliance.run(READY) == (0, "Starting ready: OK\n")
    ready = appliance.run(LISTING)[1]
    assert folders(appliance) == ["ddxstore", "thing"]
    for name in ("service", "log"):
        shutil.rmtree(appliance.root / "run" / name)
        (appliance.root / "run" / name).mkdir()
    for name in ("ddxstore", "thing"):
        assert appliance.run(f"/usr/libexec/ddx/service {name} start") == (0, f"Starting {name}: OK\n")
    assert ready.splitlines() == appliance.run(LISTING)[1].splitlines()
    for line in ("supervise/control 600 ddxhealth", "log/thing 755 ddxlog", "service/thing/once 644 root"):
        assert line in ready


def test_scripts_of_services_that_are_done_are_not_read(appliance: Appliance) -> None:
    """At a boot; later they read settings."""
    said = ["ready: OK", "ddxstore: OK", "thing: OK", "off: SKIP (disabled)", "clip: SKIP (no /test/clip)", "own: OK"]
    for name in DEFAULTS:
        if name != "own":
            script = next((appliance.root / "etc/init.d").glob(f"S??{name}"))
            script.write_text(f"echo was read\n{script.read_text()}")
    assert boot(appliance) == "".join(f"Starting {line}\n" for line in said)
    assert folders(appliance) == ["ddxstore", "own", "thing"]
    steps = [line.split() for line in (appliance.root / "run/log/boot").read_text().splitlines()]
    assert [(status, name[3:]) for _, _, status, name, _ in steps] == [("0", line.split(":")[0]) for line in said]
    assert all(float(begin) <= float(end) and float(idle) > 0 for begin, end, _, _, idle in steps)
    (appliance.root / "etc/default/thing").write_text("enabled=wrong\n")
    code, text = appliance.run("/etc/init.d/S51thing start")
    assert code == 1 and "/etc/default/thing: line 1: enabled=wrong: yes or no is needed\n" in text


@pytest.mark.parametrize("file, line, name", [
    ("data/ddx/thing.conf", "argument=mine", "thing"), ("run/settings/thing.conf", "argument=mine", "thing"),
    ("test/thing.conf", "argument=mine", "thing"), ("data/ddx/store.conf", "m=mine", "ddxstore"),
    ("data/ddx/off.conf", "enabled=yes\nx=mine", "off")])
def test_a_service_with_settings_is_written_from_them(appliance: Appliance, file: str, line: str, name: str) -> None:
    path = appliance.root / file
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(line)
    assert appliance.run(READY)[0] == 0
    assert name not in folders(appliance)
    boot(appliance)
    assert "argument=mine\n" in launch(appliance, name)


def test_a_service_that_settings_switch_off_does_not_start(appliance: Appliance) -> None:
    (appliance.root / "data/ddx").mkdir()
    (appliance.root / "data/ddx/thing.conf").write_text("enabled=no\n")
    assert "Starting thing: SKIP (disabled)\n" in boot(appliance)
    assert folders(appliance) == ["ddxstore", "own"]


def test_further_instances_and_needed_files_are_found(appliance: Appliance) -> None:
    (appliance.root / "data/ddx").mkdir()
    (appliance.root / "data/ddx/off.two.conf").write_text("enabled=yes\n")
    (appliance.root / "test/clip").write_text("")
    assert "Starting clip: OK\n" in boot(appliance)
    assert folders(appliance) == ["clip", "ddxstore", "off.two", "own", "thing"]


def test_a_later_build_makes_them_from_its_own_defaults(appliance: Appliance) -> None:
    """Buildroot uses the folder of the root file system again."""
    (appliance.root / "etc/default/thing").write_text("enabled=yes\nuser=ddxlog\nargument=new\n")
    (appliance.root / "etc/default/off").write_text("enabled=yes\nuser=ddxlog\n")
    (appliance.root / "etc/default/ddxstore").unlink()
    build(appliance)
    assert appliance.run(READY)[0] == 0
    assert folders(appliance) == ["off", "thing"]
    assert "argument=new\n" in launch(appliance, "thing")


def test_rescue_starts_none(appliance: Appliance) -> None:
    appliance.run("echo ddx.rescue > /run/words; mount --bind /run/words /proc/cmdline")
    assert boot(appliance).splitlines()[0] == "Starting ready: SKIP (rescue)"
    assert folders(appliance) == []
