# SPDX-License-Identifier: GPL-2.0-or-later
"""Sender and ddxdecode in their own network: multicast uses its loopback, and nothing leaves the machine."""
from __future__ import annotations

import base64
import json
import os
import pathlib
import re
import signal
import subprocess
from typing import Any

from parts.media.clip import frame_number

from .programs import TOP, Counters, Desk, Process, pictures, start_recorder, stop, wait_until

GROUP, PORT = "239.255.20.5", 8000  # as network.h
RELAYED = 9000
TO_RELAY = ("-group", "none", "-to", f"127.0.0.1:{RELAYED}")
# Without IPv6, only the tests of IPv6 fail.
SETUP = "ip link set lo up multicast on && ip route add 224.0.0.0/4 dev lo && " \
        "{ ip -6 route add local ff00::/8 dev lo; echo ready; exec cat; }"


class Network:
    """A network namespace that exists as long as its holder process."""

    def __init__(self) -> None:
        root = os.geteuid() == 0
        self.holder = subprocess.Popen(["unshare", "--net", *([] if root else ["--map-root-user"]), "sh", "-c", SETUP],
                                       stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert self.holder.stdout and self.holder.stdout.readline() == "ready\n"
        self.inside = ("nsenter", "--net", *([] if root else ["--user", "--preserve-credentials"]), "--target",
                       str(self.holder.pid))

    def end(self) -> None:
        self.holder.communicate()


class Stream:
    """A store, a network, and the programs in it."""

    def __init__(self, folder: pathlib.Path) -> None:
        self.desk = Desk(folder)
        self.folder = folder
        self.network = Network()

    def send(self, *options: object, wrapper: tuple[str, ...] = ()) -> Process:
        return self.desk.start("ddxvideosend", *options, wrapper=(*self.network.inside, *wrapper))

    def decode(self, *options: object) -> Process:
        """Start ddxdecode without a window, with its pictures in item `seen`; wait until it listens."""
        process = self.desk.start("ddxdecode", "-headless", "-print", "-name", "seen", *options,
                                  wrapper=self.network.inside)
        instance = options[options.index("-instance") + 1] if "-instance" in options else "ddxdecode"
        wait_until(lambda: f"{instance}.packets" in self.desk.run("ddxctl", "list").stdout)
        return process

    def record(self, clip: pathlib.Path) -> Process:
        """Record ddxdecode's pictures into seen.y4m; plays the clip's first frame, so that item `seen` exists."""
        short = self.folder / "short.y4m"
        header, first, *_ = clip.read_bytes().split(b"FRAME", 2)
        short.write_bytes(header + b"FRAME" + first)
        self.play(short, "-instance", "short")
        wait_until(lambda: self.desk.readers("seen") == 0)
        recorder = start_recorder(self.desk, "-name", "seen", "-output", "seen.y4m")
        wait_until(lambda: self.desk.readers("seen") == 1)
        return recorder

    def play(self, clip: pathlib.Path, *options: object, readers: int = 1) -> Counters:
        done = self.desk.run("ddxvideoload", clip, "-readers", readers, *options, timeout=120)
        assert done.returncode == 0, done.stderr
        return dict(json.loads(done.stdout.splitlines()[-1]))

    def play_frames(self, clip: pathlib.Path, frames: int, instance: str = "ddxvideosend", count: str = "out") -> None:
        """Play the clip in a loop until that many more frames have passed through a program."""
        before = int(self.desk.stats(instance)[count])
        loader = self.desk.start("ddxvideoload", clip, "-loop", "-readers", "1")
        wait_until(lambda: int(self.desk.stats(instance)[count]) >= before + frames, 120)
        assert stop(loader)[0] == 0

    def relay(self, *words: object, seed: str = "1", offset: int = 0) -> Process:
        """Start relay.py from port RELAYED + offset to ddxdecode's port + offset."""
        ports = (RELAYED + offset, PORT + offset)
        python = ("env", f"PYTHONPATH={TOP / 'tools'}", "/usr/bin/python3", "-B")
        process = self.desk.start(pathlib.Path(__file__).with_name("relay.py"), *ports, seed, *words,
                                  wrapper=(*self.network.inside, *python))
        assert process.stdout and process.stdout.readline() == "ready\n"
        return process

    def packets(self, instance: str) -> dict[str, int]:
        """The packet counters in the store; empty before the program has started."""
        done = self.desk.run("ddxctl", "show", "--json", f"{instance}.packets")
        return find_numbers(json.loads(done.stdout)) if done.returncode == 0 else {}

    def end(self) -> None:
        self.desk.end()
        self.network.end()


def turn(relay: Process, network: str) -> None:
    """Switch the relay to the `bad` or `good` network."""
    relay.send_signal(signal.SIGUSR1)
    assert relay.stdout and relay.stdout.readline() == f"{network}\n"


def make_key(path: pathlib.Path, mode: int = 0o600) -> None:
    """Write a key file for encrypted streams."""
    path.write_bytes(base64.b64encode(os.urandom(30)) + b"\n")
    path.chmod(mode)


def find_numbers(value: Any) -> dict[str, int]:
    """All pairs of name and number, at any depth."""
    found: dict[str, int] = {}
    if isinstance(value, dict):
        for key, inner in value.items():
            if isinstance(inner, int):
                found[key] = inner
            found.update(find_numbers(inner))
    return found


def finish(*processes: Process) -> list[tuple[list[str], dict[str, int], Counters]]:
    """Stop programs of a stream in order; return for each its printed lines, packet counters and frame counters."""
    results = []
    for process in processes:
        process.terminate()
        out, _ = process.communicate(timeout=60)
        assert process.returncode == 0
        *lines, packets, frames = out.splitlines()
        results.append((lines, json.loads(packets), json.loads(frames)))
    return results


def printed(lines: list[str]) -> list[int]:
    """The frame numbers that ddxdecode printed."""
    return [int(match[1]) for line in lines if (match := re.match(r"frame (\d+) ", line))]


def drawn(y4m: pathlib.Path, width: int = 352, height: int = 288) -> list[int | None]:
    """The frame numbers in the pictures."""
    return [frame_number(picture, width, height) for picture in pictures(y4m)]


def stop_recording(recorder: Process) -> None:
    status, counters = stop(recorder)
    assert status == 0 and counters["in"] == counters["out"]
