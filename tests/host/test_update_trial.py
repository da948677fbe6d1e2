# SPDX-License-Identifier: GPL-2.0-or-later
"""The trial of a new version, on a machine of files, with a real store: what is kept, and what is taken back."""
from __future__ import annotations

import contextlib
import pathlib
import signal
import socket
import subprocess
import threading
from collections.abc import Callable, Iterator

import pytest

from lib.boot_block import BYTES, block_of, make_fat, text_of
from parts.common import MORTAL
from parts.image import native
from parts.media import clip

from .programs import Desk, library_folder, send_signal, start_recorder, wait_for_recorder, wait_until

pytestmark = pytest.mark.retry

TRIAL = {"slot": "B", "left": "2"}
STATES = ("store enabled=yes state=running pid=1 restarts=0\nthing enabled=yes state=running pid=2 restarts=0\n"
          "other enabled=no state=stopped pid=- restarts=0\n")
FORMER = {"tried": "B", "version": "0.3.0", "result": "begun", "runs": "store thing", "flows": "", "links": "eth0",
          "addresses": "eth0", "ssh": "no", "watchdog": "yes"}
ROUTES = "Iface\tDestination\tGateway\neth0\t00000000\t0100A8C0\n"


class Machine:
    """Its files, and a boot partition. All is well, unless a test changes a file."""

    def __init__(self, folder: pathlib.Path, desk: Desk) -> None:
        self.folder, self.desk, self.card = folder, desk, folder / "card"
        make_fat(self.card, TRIAL)
        self.at = self.card.read_bytes().index(text_of(TRIAL))
        self.write("proc/cmdline", "ddx.slot=B ddx.layout=1 ddx.counted=left=2\n")
        self.write("etc/os-release", 'VARIANT_ID=test\nVERSION="0.3.0"\n')
        self.rules(good=0.5, deadline=1000)
        self.write("run/update.services", STATES)
        for name in ("store", "thing"):
            self.service(name)
        self.write("sys/class/net/eth0/carrier", "1\n")
        self.write("sys/class/net/lo/carrier", "1\n")
        self.write("proc/net/route", ROUTES)
        self.write("sys/class/watchdog/watchdog0/state", "active\n")
        self.former()

    def write(self, name: str, text: str) -> "Machine":
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        new = path.with_name(f".{path.name}.new")
        new.write_text(text)
        new.rename(path)
        return self

    def rules(self, **rules: float) -> "Machine":
        self.write("etc/ddx/trial", "".join(f"{name}={value}\n" for name, value in {"step": 0.1, **rules}.items()))
        return self

    def former(self, **changes: str) -> "Machine":
        self.write("data/update", "".join(f"{name}={value}\n" for name, value in {**FORMER, **changes}.items()))
        return self

    def service(self, name: str, stat: str = "run", restarts: int = 0) -> "Machine":
        self.write(f"run/service/{name}/run", "#!/bin/sh\n")
        self.write(f"run/service/{name}/restarts", f"{restarts}\n")
        self.write(f"run/service/{name}/supervise/stat", f"{stat}\n")
        return self

    def start(self, command: str = "trial") -> subprocess.Popen[str]:
        program = native.build() / "usr/libexec/ddx/ddxupdate"
        return subprocess.Popen([*MORTAL, program, "-root", self.folder, command, self.card], text=True,
                                env=self.desk.environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)

    def run(self, command: str = "trial") -> tuple[int, str]:
        process = self.start(command)
        try:
            said, _ = process.communicate(timeout=60)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            pytest.fail(f"{command} goes on: {self.progress()}")
        return process.returncode, said

    def block(self) -> dict[str, str] | None:
        return block_of(self.card.read_bytes()[self.at:self.at + BYTES])

    def remembered(self, name: str) -> str:
        lines = (self.folder / "data/update").read_text().splitlines()
        return dict(line.split("=", 1) for line in lines)[name]

    def progress(self) -> str:
        path = self.folder / "run/update.trial"
        return path.read_text() if path.exists() else ""

    def is_kept(self) -> bool:
        return self.block() == {"slot": "B"} and self.remembered("result") == "kept" and not self.progress()


@pytest.fixture(name="desk", scope="module")
def _desk(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Desk]:
    desk = Desk(tmp_path_factory.mktemp("desk"))
    yield desk
    desk.end()


@pytest.fixture(name="machine")
def _machine(tmp_path: pathlib.Path, desk: Desk) -> Machine:
    return Machine(tmp_path, desk)


Change = Callable[[Machine], object]

GOOD: dict[str, Change] = {
    "all-well": lambda machine: None,
    "no-carrier": lambda machine: (machine.write("sys/class/net/eth0/carrier", "0\n"),
                                   machine.write("proc/net/route", "Iface\n")),
    "stopped-by-a-person": lambda machine: (machine.service("thing", "down"),
                                            machine.write("run/service/thing/down", "")),
    "its-disk-is-full": lambda machine: (machine.service("thing", "finish", 3), machine.write(
        "run/log/thing/current", "thing: recording stopped, No space left on device; make room and start again\n")),
    "not-enabled": lambda machine: (machine.write("run/update.services", STATES.replace("thing enabled=yes",
                                                                                        "thing enabled=no")),
                                    machine.service("thing", "down")),
    "did-not-run-before": lambda machine: (machine.former(runs="store"), machine.service("thing", "finish")),
    "has-done-its-work": lambda machine: (machine.service("thing", "down"),
                                          machine.write("run/service/thing/complete", "")),
    "nothing-remembered": lambda machine: (machine.former(version="0.2.0", links="wlan0"),
                                           machine.write("proc/net/route", "Iface\n")),
    "ipv6": lambda machine: (machine.write("proc/net/route", "Iface\n"),
                             machine.write("proc/net/if_inet6", "20010db8000000000000000000000001 02 40 00 80 eth0\n")),
}


@pytest.mark.parametrize("change", GOOD.values(), ids=GOOD)
def test_a_good_version_is_kept(machine: Machine, change: Change) -> None:
    change(machine)
    assert machine.run() == (0, "")
    assert machine.is_kept() and machine.remembered("proven") == "B"


BAD: dict[str, tuple[Change, str]] = {
    "dead": (lambda machine: machine.service("thing", "finish"), "thing does not run"),
    "waits": (lambda machine: machine.write("run/service/thing/waiting", ""), "thing does not run"),
    "never-started": (lambda machine: (machine.folder / "run/service/thing/run").unlink(), "thing does not run"),
    "dead-and-nothing-remembered": (lambda machine: (machine.service("thing", "finish"), machine.former(tried="A")),
                                    "thing does not run"),
    "no-frames": (lambda machine: (machine.former(flows="ddxvideosave"), machine.service("ddxvideosave"),
                                   machine.write("run/update.services", STATES + "ddxvideosave enabled=yes "
                                                 "state=running pid=3 restarts=0\n")), "ddxvideosave: no new frame"),
    "no-interface": (lambda machine: machine.former(links="eth0 wlan0"), "the network interface wlan0 is missing"),
    "no-address": (lambda machine: machine.write("proc/net/route", "Iface\neth00 x\n"),
                   "the network interface eth0 has no address"),
    "local-address": (lambda machine: (machine.write("proc/net/route", "Iface\n"), machine.write(
        "proc/net/if_inet6", "fe80000000000000 02 40 20 80 eth0\n")), "the network interface eth0 has no address"),
    "no-ssh": (lambda machine: (machine.former(ssh="yes"), machine.rules(good=0.5, deadline=0.5, ssh=1)),
               "SSH does not answer"),
    "no-watchdog": (lambda machine: machine.write("sys/class/watchdog/watchdog0/state", "inactive\n"),
                    "the watchdog is not active"),
}


@pytest.mark.parametrize("change, reason", BAD.values(), ids=BAD)
def test_a_bad_version_is_not_kept(machine: Machine, change: Change, reason: str) -> None:
    machine.rules(good=0.5, deadline=0.5)
    change(machine)
    assert machine.run() == (1, f"{reason}\n")
    assert machine.block() == TRIAL and machine.remembered("result") == "begun" and not machine.progress()


@pytest.mark.parametrize("states", [STATES, STATES.replace("thing enabled=yes state=running",
                                                           "thing enabled=no state=misconfigured")])
def test_settings_that_are_refused_end_the_trial_at_once(machine: Machine, states: str) -> None:
    machine.write("run/update.services", states)
    if states == STATES:
        machine.service("thing", "down")
        machine.write("run/service/thing/misconfigured", "")
    else:
        (machine.folder / "run/service/thing/run").unlink()
    assert machine.run() == (1, "thing refuses its settings\n")


@pytest.mark.parametrize("rules", [{"deadline": 0.5}, {"deadline": 1000, "silence": 0.5}], ids=["deadline", "silence"])
def test_without_a_store_no_version_is_kept(machine: Machine, rules: dict[str, float]) -> None:
    """It is taken back before the watchdog, which is fed no longer, resets the machine."""
    machine.rules(good=0.5, **rules)
    machine.desk = Desk.__new__(Desk)
    machine.desk.environment = {"DDX_DIR": str(machine.folder / "none"), "LD_LIBRARY_PATH": str(library_folder())}
    assert machine.run() == (1, "the store does not answer\n")


def test_a_service_that_is_started_again_and_again(machine: Machine) -> None:
    machine.rules(good=0.5, deadline=1)
    done = threading.Event()

    def restart() -> None:
        count = 0
        while not done.wait(0.02):
            count += 1
            machine.service("thing", restarts=count)

    thread = threading.Thread(target=restart)
    thread.start()
    try:
        assert machine.run() == (1, "thing died and had to be started again\n")
    finally:
        done.set()
        thread.join()


def test_well_means_in_a_row(machine: Machine) -> None:
    """A service that stops in between costs what was good before."""
    machine.rules(good=1000, deadline=1000)
    process = machine.start()
    wait_until(lambda: "all well for 1 of" in machine.progress())
    machine.service("thing", "finish")
    wait_until(lambda: "thing does not run; taken back in" in machine.progress())
    machine.service("thing")
    wait_until(lambda: "all well for 0 of" in machine.progress())
    process.kill()
    process.communicate()


def test_the_check_of_the_recordings_does_not_count(machine: Machine) -> None:
    """The recorder waits for it, for an hour on a large disk."""
    machine.rules(good=0.5, deadline=0.3)
    machine.write("run/log/recordings-disk", "/dev/sda6 is being checked\n")
    machine.write("run/service/thing/waiting", "")
    process = machine.start()
    looks = set[int]()

    def looked() -> bool:
        if machine.progress():
            looks.add((machine.folder / "run/update.trial").stat().st_mtime_ns)
        return len(looks) > 8

    wait_until(looked)
    assert process.poll() is None
    (machine.folder / "run/service/thing/waiting").unlink()
    machine.write("run/log/recordings-disk", "/dev/sda6 is being checked\n/dev/sda6 is there\n")
    assert process.communicate(timeout=60)[0] == "" and machine.is_kept()


@pytest.mark.parametrize("decided", ["keep", "back"])
def test_a_person_decides_meanwhile(machine: Machine, decided: str) -> None:
    machine.rules(good=1000, deadline=1000)
    process = machine.start()
    wait_until(lambda: bool(machine.progress()))
    if decided == "keep":
        assert machine.run("keep") == (0, "")
    else:
        with machine.card.open("r+b") as file:
            file.seek(machine.at)
            file.write(text_of({"failed": "B"}))
    assert (process.communicate(timeout=60)[0], process.returncode) == ("", 0)
    assert machine.block() == ({"slot": "B"} if decided == "keep" else {"failed": "B"})


def test_ssh_answers(machine: Machine) -> None:
    with contextlib.closing(socket.create_server(("127.0.0.1", 0))) as server:
        def answer() -> None:
            with contextlib.suppress(OSError):
                while True:
                    server.accept()[0].sendall(b"SSH-2.0-test\r\n")

        thread = threading.Thread(target=answer, daemon=True)
        thread.start()
        machine.former(ssh="yes")
        machine.rules(good=0.5, deadline=1000, ssh=server.getsockname()[1])
        assert machine.run() == (0, "") and machine.is_kept()
        server.shutdown(socket.SHUT_RDWR)
    thread.join(60)


def test_frames_must_continue(machine: Machine, tmp_path: pathlib.Path) -> None:
    """A recorder that hangs is noticed by its counters; then it goes on, and the version is kept."""
    desk_folder = tmp_path / "desk"
    desk_folder.mkdir()
    desk = Desk(desk_folder)
    machine.desk = desk
    try:
        recorder = start_recorder(desk, "-output", "out.y4m")
        wait_for_recorder(desk)
        desk.start("ddxvideoload", "-loop", clip.write(tmp_path / "clip.y4m", 2))
        wait_until(lambda: desk.out("ddxvideosave") > 0)
        machine.former(flows="ddxvideosave")
        machine.service("ddxvideosave")
        machine.write("run/update.services", STATES + "ddxvideosave enabled=yes state=running pid=3 restarts=0\n")
        machine.rules(good=1000, deadline=1000, step=1.5)
        process = machine.start()
        wait_until(lambda: "all well for" in machine.progress())
        send_signal(recorder, signal.SIGSTOP)
        wait_until(lambda: "ddxvideosave: no new frame" in machine.progress())
        process.kill()
        process.communicate()
        send_signal(recorder, signal.SIGCONT)
        machine.rules(good=1, deadline=1000, step=1.5)
        assert machine.run() == (0, "") and machine.is_kept()
    finally:
        desk.end()
