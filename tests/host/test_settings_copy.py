# SPDX-License-Identifier: GPL-2.0-or-later
"""The second copy of the settings is on a disk whose top folder belongs to the recorder's user. That user can change
any name there at any time, but cannot make root write another file or accept a copy that is not root's."""
from __future__ import annotations

import os
import pathlib
from collections.abc import Iterator

import pytest

from parts.common import TOP

from .appliance import Appliance, with_service

pytestmark = pytest.mark.retry

SCRIPTS = {f"overlay/usr/libexec/ddx/{name}": f"usr/libexec/ddx/{name}" for name in ("settings-copy", "restore.awk")}
SAVE = "/usr/libexec/ddx/settings-copy save"
RESTORE = "/usr/libexec/ddx/settings-copy restore /rec"
THIEF = "chpst -u ddxsave:ddx sh -ec"
COPY = "/rec/.ddx/settings"
UNCOPIED = ("settings have no copy: /rec/.ddx cannot be made, or is not root's alone "
            "(remove it, then toggle a service)\n")


@pytest.fixture
def robot(tmp_path: pathlib.Path) -> Iterator[Appliance]:
    """An appliance with the recorder's disk, settings, and files that only root may read and write."""
    with with_service(tmp_path) as robot:
        for script, to in SCRIPTS.items():
            robot.install(script, to)
        for name in ("data/ddx", "rec", "vault"):
            (robot.root / name).mkdir(parents=True)
        with (robot.root / "etc/passwd").open("a") as users:
            users.write("ddxsave:x:903:900::/:/bin/sh\nddxlogger:x:909:900::/:/bin/sh\n")
        (robot.root / "etc/default/thing").write_text("user=ddxsave\n")
        (robot.root / "data/ddx/thing.conf").write_text("enabled=no\n")
        assert robot.run("chmod 700 /vault; echo secret > /vault/settings; "
                         "mount -t tmpfs -o mode=2755 rec /rec && chown ddxsave:ddx /rec")[0] == 0
        yield robot


def vault(robot: Appliance) -> str:
    """The complete state of root's files."""
    return robot.run("cd /vault && ls -A && cat settings && stat -c '%U %a' .")[1]


def test_a_copy_belongs_to_root_and_is_restored(robot: Appliance) -> None:
    (robot.root / "data/ddx/thing.a.conf").write_text("enabled=yes\nrate=5")  # no newline at the end
    (robot.root / "data/ddx/logger.conf").write_text("output /rec/log\n")
    robot.run("echo old > /rec/.settings")
    assert robot.run(f"{SAVE} && stat -c '%U %A' /rec/.ddx {COPY} && ls -A /rec /rec/.ddx") == (
        0, "root drwx------\nroot -rw-------\n/rec:\n.ddx\n\n/rec/.ddx:\nsettings\n")
    before = robot.run(f"stat -c %i {COPY}")[1]
    assert robot.run(f"{SAVE}; stat -c %i {COPY}")[1] == before  # without a change nothing is written
    for file in (robot.root / "data/ddx").iterdir():
        file.unlink()
    (robot.root / "data/ddx/other.conf").touch()
    assert robot.run(RESTORE) == (0, "")
    assert robot.run("cd /data/ddx && grep '' *")[1].splitlines() == [
        "logger.conf:output /rec/log", "thing.a.conf:enabled=yes", "thing.a.conf:rate=5", "thing.conf:enabled=no"]
    assert robot.run(f"{THIEF} 'cat {COPY} || ls /rec/.ddx'")[0] != 0


def test_planted_names_of_temporary_files_are_harmless(robot: Appliance) -> None:
    """settings-copy of earlier images used names that end with its process number."""
    inside = robot.enter[robot.enter.index("--target") + 1]
    for end in ["", *(f".{number}" for number in range(1, 2000))]:
        link = f"/proc/{inside}/root/rec/.settings{end}"
        os.symlink("/vault/settings", link)
        os.lchown(link, 903, 900)
    before = vault(robot)
    assert robot.run(SAVE) == (0, "")
    assert vault(robot) == before and "enabled=no" in robot.run(f"cat {COPY}")[1]


def test_root_writes_no_file_through_a_planted_name(robot: Appliance) -> None:
    before = vault(robot)
    told = robot.root / "run/settings.uncopied"
    for planted in (
            "ln -s /vault .ddx", "ln -s /vault/settings .ddx",
            "ln -s /rec/x .ddx; mkdir -m 700 x; ln -s /vault/settings x/settings",
            "mkdir -m 700 .ddx; ln -s /vault/settings .ddx/settings.new; ln -s /vault/settings .ddx/settings",
            "mkdir .ddx; mkfifo .ddx/settings.new .ddx/settings", "mkfifo .ddx"):
        assert robot.run(f"{THIEF} 'cd /rec; {planted}'")[0] == 0
        code, text = robot.run(SAVE)
        assert vault(robot) == before
        assert (code, text, told.read_text()) == (1, "", UNCOPIED)
        robot.run(f"rm -rf /rec/.ddx && {SAVE}")  # as the message advises
        assert not told.exists() and "enabled=no" in robot.run(f"cat {COPY}")[1]
        robot.run("rm -rf /rec/.ddx /rec/x")


FORGED = "printf \"--- thing.conf ---\\nenabled=yes\\n\""


def test_a_forged_copy_is_not_used(robot: Appliance) -> None:
    for forged in (
            f"mkdir -m 700 .ddx; {FORGED} > .ddx/settings", f"{FORGED} > settings; ln -s /rec .ddx", "ln -s x .ddx",
            f"{FORGED} > .settings"):
        (robot.root / "data/ddx/thing.conf").write_text("enabled=yes\n")
        assert robot.run(SAVE) == (0, "")
        (robot.root / "data/ddx/thing.conf").write_text("enabled=no\n")
        assert robot.run(f"{THIEF} 'cd /rec; mv .ddx x; {forged}'")[0] == 0
        text = "the copy of an earlier image is not used, since other users could write it\n"
        earlier = text if ".settings" in forged else ""
        assert robot.run(RESTORE) == (1, earlier)
        assert (robot.root / "data/ddx/thing.conf").read_text() == "enabled=no\n"
        robot.run("rm -rf /rec/.ddx /rec/x /rec/settings")


def test_a_copy_with_unsafe_rights_is_not_used(robot: Appliance) -> None:
    for spoil in (f"chown ddxsave {COPY}", "chmod 755 /rec/.ddx", f"ln {COPY} /rec/x",
                  f"mv {COPY} /rec/x; ln -s ../x {COPY}"):
        assert robot.run(f"{SAVE} && {RESTORE}") == (0, "")
        assert robot.run(spoil)[0] == 0 and robot.run(RESTORE) == (1, "")
        robot.run("rm -rf /rec/.ddx /rec/x")


def test_only_valid_lines_are_restored(robot: Appliance) -> None:
    """A file with a line that `service` refuses switches the service off, as before."""
    (robot.root / "data/ddx/thing.conf").write_text("user=root\n# mine\nrate=$(x)\nnonsense\nname=a\033b\n")
    (robot.root / "data/ddx/thing.a.conf").write_text("enabled=yes\nmounted=$(touch /x)\nrate=5\n")
    (robot.root / "data/ddx/logger.conf").write_text("output /rec/log\n\titem\tx\r\nitem \033\n")
    assert robot.run(f"{SAVE} && {RESTORE}") == (
        0, "logger.conf line 3, thing.a.conf line 2, thing.conf line 1, thing.conf line 4, thing.conf line 5\n")
    found = {name: (robot.root / f"data/ddx/{name}.conf").read_bytes() for name in ("thing", "thing.a", "logger")}
    assert found == {"thing": b"# mine\nrate=$(x)\n", "thing.a": b"enabled=yes\nrate=5\nenabled=no\n",
                     "logger": b"output /rec/log\n\titem\tx\r\n"}
    assert robot.run("/usr/libexec/ddx/service thing status thing.a")[1].startswith("thing.a enabled=no state=stopped")


def test_no_folder_of_root_is_given_to_the_logger(robot: Appliance) -> None:
    """Even if the recorder's user replaces the log's folder by a link at the worst moment of mounting."""
    script = (TOP / "overlay/usr/libexec/ddx/recordings-disk").read_text()
    begin = script.index("give_away() {")
    give_away = script[begin:script.index("\n}\n", begin) + 3]
    meanwhile = 'mkdir() {\n command mkdir "$@"\n rmdir /rec/log\n ln -s /vault /rec/log\n}\n'
    before = vault(robot)
    robot.add("give", f"{meanwhile}{give_away}give_away\n")
    robot.run("sh /give")
    assert robot.run("readlink /rec/log")[1] == "/vault\n" and vault(robot) == before
    robot.add("give", f"{give_away}give_away\n")
    assert robot.run("rm /rec/log; sh /give; stat -c '%U %a' /rec/log") == (0, "ddxlogger 2755\n")
