# SPDX-License-Identifier: GPL-2.0-or-later
"""SSH: only keys in ddx.txt can log in; recordings can be copied; no other port is open."""
import contextlib
import pathlib
import re
import socket
import subprocess
from collections.abc import Iterator

import pytest

from lib import manifest
from parts.common import PATIENCE, run
from parts.guest import session, testdisk
from parts.guest.laptop import forward, free_port
from parts.guest.qemu import Boot, Guest
from parts.media import clip as default_clip
from parts.media.recording import FileSystem

from .test_control import runs

pytestmark = pytest.mark.retry

SECONDS = 4
WAITING = 5  # connections of an address that have not logged in: dropbear's own limit


class Robot:
    """The guest, seen from the network."""

    def __init__(self, guest: Guest, port: int, folder: pathlib.Path) -> None:
        self.guest, self.port, self.folder = guest, port, folder

    def options(self, key: str) -> list[str]:
        words = ["BatchMode=yes", "IdentitiesOnly=yes", f"IdentityFile={self.folder / key}", "ConnectTimeout=30",
                 f"UserKnownHostsFile={self.folder}/known_hosts", "StrictHostKeyChecking=accept-new"]
        return ["-F", "none", *(part for word in words for part in ("-o", word))]

    def ssh(self, *command: str, key: str = "mine") -> "subprocess.CompletedProcess[str]":
        words = ["ssh", *self.options(key), "-p", str(self.port), "root@127.0.0.1", *command]
        return subprocess.run(words, capture_output=True, text=True, check=False, timeout=PATIENCE)


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    folder = tmp_path_factory.mktemp("ssh")
    for name in ("mine", "other"):
        run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-C", name, "-f", folder / name])
    return folder


@pytest.fixture(scope="module")
def robot(boot: Boot, work: pathlib.Path, place: pathlib.Path) -> Iterator[Robot]:
    clip = default_clip.write(work / "ssh.y4m", SECONDS)
    disk = testdisk.make(work / "ssh.img", clip)
    port = free_port()
    provision = f"network=eth0 dhcp\nssh_key={(place / 'mine.pub').read_text()}" \
                "service=ddxdecode on\nservice=ddxvideosend on\nservice=ddxcatalog on\n" \
                "panel=open-sesame-42\n"
    with boot("ssh", provision=provision, test_disk=disk, keep=place, extra=forward(port)) as guest:
        guest.shell()
        session.wait_for_clip(guest, SECONDS * default_clip.RATE)
        session.stop_recorder(guest)
        guest.wait_until("netstat -tln | grep -q :22")
        yield Robot(guest, port, place)


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
    for name in ("ddxdecode", "ddxvideosend"):
        runs(robot.guest, name)
    robot.guest.wait_until("netstat -uln | grep -q :7411")
    robot.guest.wait_until("ddxctl logs ddxpanel | grep -q ready")
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
