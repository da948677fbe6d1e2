# SPDX-License-Identifier: GPL-2.0-or-later
"""SSH: only keys in ddx.txt can log in; recordings can be copied; no other port is open."""
import contextlib
import pathlib
import re
import socket

import pytest

from lib import manifest
from parts.common import PATIENCE, run
from parts.guest.laptop import forward
from parts.guest.qemu import Boot
from parts.media.recording import FileSystem

from .networked import Robot, Streamed
from .test_control import runs

pytestmark = pytest.mark.retry

WAITING = 5  # connections of an address that have not logged in: dropbear's own limit


@pytest.fixture(scope="module", autouse=True)
def has_recording(robot: Robot, streamed: Streamed) -> None:
    """There is a recording to be copied."""
    robot.guest.wait_until("netstat -tln | grep -q :22")


def test_the_provisioned_key_logs_in(robot: Robot) -> None:
    done = robot.ssh("id -u; ddxctl services")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("0\n") and "ddxvideosave" in done.stdout


def test_another_key_is_refused(robot: Robot) -> None:
    done = robot.ssh("true", key="other")
    assert done.returncode == 255 and "Permission denied (publickey)" in done.stderr  # not even a password prompt


def test_few_connections_wait_for_a_login(robot: Robot) -> None:
    """All of them, and what they start, yield to the robot's programs."""
    with contextlib.ExitStack() as stack:
        clients = [stack.enter_context(socket.create_connection(("127.0.0.1", robot.port), PATIENCE))
                   for _ in range(WAITING + 3)]
        assert sum(client.recv(4) == b"SSH-" for client in clients) == WAITING
        assert set(robot.guest.sh("cut -d' ' -f19 $(pidof dropbear | sed 's,[0-9]*,/proc/&/stat,g')").split()) == {"10"}
    robot.guest.wait_until("test $(pidof dropbear | wc -w) = 1")  # there is room again
    assert robot.ssh("cut -d' ' -f19 /proc/self/stat").stdout == "10\n"


def test_recordings_can_be_copied(robot: Robot, tmp_path: pathlib.Path) -> None:
    partition = FileSystem(robot.guest.snapshot())
    name = partition.recordings()[0][0]
    wanted = partition.take(name, tmp_path / "wanted.y4m").read_bytes()
    options = robot.options("mine")
    shell = " ".join(["ssh", *options, "-p", str(robot.port)])
    run(["rsync", "-e", shell, f"root@127.0.0.1:/rec/{name}", tmp_path / "rsync.y4m"])
    run(["sftp", "-q", *options, "-P", str(robot.port), f"root@127.0.0.1:/rec/{name}", tmp_path / "sftp.y4m"])
    assert (tmp_path / "rsync.y4m").read_bytes() == (tmp_path / "sftp.y4m").read_bytes() == wanted


# Clients before OpenSSH 9.0 need the program scp on the robot; later ones use SFTP.
@pytest.mark.parametrize("protocol", ["-O", "-s"])
def test_scp_copies_recordings(robot: Robot, tmp_path: pathlib.Path, protocol: str) -> None:
    run(["scp", protocol, "-q", *robot.options("mine"), "-P", str(robot.port), "root@127.0.0.1:/rec/*.y4m", tmp_path])
    partition = FileSystem(robot.guest.snapshot())
    names = [name for files in partition.recordings() for name in files]
    assert names and sorted(path.name for path in tmp_path.iterdir()) == sorted(names)
    for name in names:
        assert (tmp_path / name).read_bytes() == partition.take(name, tmp_path / "wanted").read_bytes()


def test_only_declared_ports_listen(robot: Robot) -> None:
    robot.guest.sh("ddxctl enable ddxdecode; sv down /run/service/ntp")  # a question about the time has a port, too
    for name in ("ddxdecode", "ddxvideosend"):
        runs(robot.guest, name)
    robot.guest.wait_until("netstat -uln | grep -q :7411")
    robot.guest.wait_until("ddxctl logs ddxpanel | grep -q ready")
    robot.guest.wait_until("netstat -uln | grep -q :5353")
    found = re.findall(r"^(tcp|udp)\s.*?:(\d+)\s.*/(\S+)", robot.guest.sh("netstat -tulnp"), re.M)
    assert manifest.ports({(kind, int(port), program) for kind, port, program in found}) == []


@pytest.mark.long
def test_the_host_key_survives_a_reboot(robot: Robot, boot: Boot) -> None:
    """After a second boot on the same disk the client sees the known key; it would refuse another one."""
    assert robot.ssh("true").returncode == 0
    known = (robot.folder / "known_hosts").read_text()
    assert "ssh-ed25519" in known
    robot.guest.poweroff()
    with boot("ssh-again", keep=robot.folder, extra=forward(robot.port)) as guest:
        guest.shell()
        guest.wait_until("netstat -tln | grep -q :22")
        assert Robot(guest, robot.port, robot.folder).ssh("true").returncode == 0
    assert (robot.folder / "known_hosts").read_text() == known
