# SPDX-License-Identifier: GPL-2.0-or-later
"""A guest with three network cards and each service that uses the network, as ddx.txt provisions it."""
import dataclasses
import json
import pathlib
import subprocess
from typing import Any

from parts.common import PATIENCE, run
from parts.guest import session
from parts.guest.qemu import Guest
from parts.media import clip as default_clip

CLIP_SECONDS = 4
FRAMES = CLIP_SECONDS * default_clip.RATE
# MPEG-4: an emulated processor is too slow for H.264. The clip begins with the third reader: recorder, sender, a shell.
SETTINGS = {"ddxvideosend.conf": "codec=mpeg4\ninterface=lo\n", "ddxvideoload.conf": "readers=3\n"}
WRONG = "network=eth2 192.168.8.300/24"
PROVISION = f"""\
hostname=robot1
network=eth0 dhcp
network=eth1 192.168.7.2/24 192.168.7.1
{WRONG}
service=ddxvideosend on
service=ddxcatalog on
service=ddxvideosave off
ntp=192.168.7.1
panel=open-sesame-42
"""
WRONG_LINE = 3 + PROVISION.splitlines().index(WRONG)  # two lines come first: for the console and the test disk
KEYS = ("mine", "other")


def make_keys(folder: pathlib.Path) -> None:
    for name in KEYS:
        run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-C", name, "-f", folder / name])


def cards(port: int, count: int = 3) -> tuple[str, ...]:
    """QEMU's options for the cards; the guest's SSH is at this port of the host."""
    forward = ("", f",hostfwd=tcp:127.0.0.1:{port}-:22")
    return tuple(word for number in range(count) for word in (
        "-netdev", f"user,id=net{number},ipv6=off{forward[number == 0]}",
        "-device", f"virtio-net-pci,netdev=net{number},id=card{number}"))


@dataclasses.dataclass
class Robot:
    """The guest, seen from the network."""

    guest: Guest
    port: int
    folder: pathlib.Path  # keys, and the guest's disk

    def options(self, key: str) -> list[str]:
        words = ["BatchMode=yes", "IdentitiesOnly=yes", f"IdentityFile={self.folder / key}", "ConnectTimeout=30",
                 f"UserKnownHostsFile={self.folder}/known_hosts", "StrictHostKeyChecking=accept-new"]
        return ["-F", "none", *(part for word in words for part in ("-o", word))]

    def ssh(self, *command: str, key: str = KEYS[0]) -> "subprocess.CompletedProcess[str]":
        words = ["ssh", *self.options(key), "-p", str(self.port), "root@127.0.0.1", *command]
        return subprocess.run(words, capture_output=True, text=True, check=False, timeout=PATIENCE)


@dataclasses.dataclass
class Streamed:
    result: session.Result  # of the recording
    shown: list[str]        # a line for each frame
    packets: dict[str, int]
    frames: dict[str, Any]
    said: str               # by the receiver and the sender


def stream(guest: Guest, clip: pathlib.Path, recording: pathlib.Path) -> Streamed:
    """Record the clip and show it from the network. Afterwards the recorder is stopped, and /rec is read-only."""
    guest.sh("ddxctl enable ddxvideosave")
    guest.sh("ddxdecode -headless -interface lo -print > /tmp/shown 2> /tmp/said &")
    guest.wait_until("netstat -uln | grep -q :8000", pause=0.1)
    # The loader may not have made the item yet.
    guest.sh("until ddxctl watch video; do sleep 0.1; done > /dev/null 2>&1 &")
    session.wait_for_clip(guest, FRAMES)
    sent = f"\"ddxvideosend\",\"in\":{FRAMES},\"out\":[0-9]*,\"waiting\":0"
    guest.wait_until(f"ddxctl stats --json | grep -q '{sent}'")
    guest.sh("kill $(pidof ddxdecode)")
    guest.wait_until("! pidof ddxdecode", pause=0.1)
    *shown, packets, frames = guest.sh("cat /tmp/shown").splitlines()
    said = guest.sh("cat /tmp/said /run/log/ddxvideosend/current")
    session.stop_recorder(guest)
    return Streamed(session.collect(guest, clip, recording), shown, json.loads(packets), json.loads(frames), said)
