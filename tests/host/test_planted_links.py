# SPDX-License-Identifier: GPL-2.0-or-later
"""Root's scripts do not follow a link that another user put in the place of a file."""
from __future__ import annotations

import os
import pathlib
from collections.abc import Iterator

import pytest

from .appliance import USERS, Appliance, with_service

pytestmark = pytest.mark.retry

SECRET = "root's own\n"
LIMITS = "s131072\nn3\n"  # svlogd's settings of a log


@pytest.fixture
def appliance(tmp_path: pathlib.Path) -> Iterator[Appliance]:
    """An appliance with a file that only root can read."""
    with with_service(tmp_path) as appliance:
        (appliance.root / "secret").write_text(SECRET)
        (appliance.root / "secret").chmod(0o600)
        yield appliance


def plant(appliance: Appliance, path: str) -> None:
    """Replace a file by a link to root's file."""
    file = appliance.root / path
    file.unlink()
    file.symlink_to("/secret")
    os.lchown(file, USERS["ddxlog"], 0)


@pytest.mark.parametrize("command, log", [
    ("/usr/libexec/ddx/service thing start", "run/log/thing"), ("/etc/init.d/S18network start", "run/log/ntp")])
def test_root_does_not_write_into_a_log_folder_of_another_user(appliance: Appliance, command: str, log: str) -> None:
    appliance.add("usr/bin/thing", "#!/bin/sh\n")
    (appliance.root / "etc/default/thing").write_text("user=ddxlog\n")
    appliance.install("overlay/etc/init.d/S18network", "etc/init.d/S18network")
    (appliance.root / "run/provision").write_text("ntp=10.0.0.1 time.example\n")
    assert appliance.run(command)[0] == 0
    folder = appliance.root / log
    assert (folder.stat().st_uid, (folder / "config").read_text()) == (USERS["ddxlog"], LIMITS)
    assert [one.name for one in (appliance.root / "run/log").iterdir()] == [folder.name]
    plant(appliance, f"{log}/config")
    assert appliance.run(command)[0] == 0
    assert (appliance.root / "secret").read_text() == SECRET


def test_arguments_of_network_services_stay_words(appliance: Appliance) -> None:
    appliance.install("overlay/etc/init.d/S18network", "etc/init.d/S18network")
    (appliance.root / "run/provision").write_text("ntp=10.0.0.1 time.example\nnetwork=eth0 10.0.0.2/24 10.0.0.1\n")
    assert appliance.run("/etc/init.d/S18network start") == (0, "Starting network: OK\n")
    files = [appliance.root / f"run/service/{name}/launch" for name in ("ntp", "network.eth0")]
    found = [file.read_text().replace("\nargument=", " ") for file in files]
    confine = "user=root /usr/libexec/ddx/confine"
    assert found == [
        f"{confine} sys_time ntpd -n -p 10.0.0.1 -p time.example\nend\n",
        f"{confine} net_admin,net_raw,net_bind_service /usr/libexec/ddx/network eth0 10.0.0.2/24 10.0.0.1\nend\n"]


def test_logs_are_read_with_the_rights_of_their_writer(appliance: Appliance) -> None:
    appliance.install("package/ddxservice/control", "usr/libexec/ddx/ctl-logs")
    (appliance.root / "etc/default/thing").write_text("user=ddxlog\n")
    appliance.add("etc/init.d/S50thing", "#!/bin/sh\n")
    folder = appliance.root / "run/log/thing"
    folder.mkdir()
    for name in ("@0.s", "current"):
        (folder / name).write_text(f"{name}\n")
        os.chown(folder / name, USERS["ddxlog"], 0)
        (folder / name).chmod(0o600)
    assert appliance.run("/usr/libexec/ddx/ctl-logs thing") == (0, "@0.s\ncurrent\n")
    plant(appliance, "run/log/thing/current")
    assert SECRET not in appliance.run("/usr/libexec/ddx/ctl-logs thing")[1]


def test_the_console_s_shell_reads_no_files_of_other_users(appliance: Appliance) -> None:
    """Any user can write into /tmp."""
    appliance.install("overlay/usr/libexec/ddx/shell", "usr/libexec/ddx/shell")
    (appliance.root / "etc/motd").write_text("DDXVIDEO\n")
    (appliance.root / "tmp").mkdir()
    (appliance.root / "tmp/.profile").write_text("echo planted\n")
    assert appliance.run("echo 'stat -c %a $HOME' | /usr/libexec/ddx/shell") == (0, "DDXVIDEO\n700\n")
