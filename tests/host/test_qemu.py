# SPDX-License-Identifier: GPL-2.0-or-later
"""The control of QEMU, without a guest that boots: an answer or an error, and all files are removed."""
from __future__ import annotations

import os
import pathlib
import socket
import subprocess
import sys
import threading
import time

import pytest

from parts import common
from parts.common import PATIENCE, TOP, Failed
from parts.guest import qemu
from parts.guest.qmp import Monitor, NotListening

pytestmark = pytest.mark.retry

GREETING = b'{"QMP": {"version": {}, "capabilities": []}}\n'
DONE = b'{"return": {}}\n'


def monitor(path: pathlib.Path, said: bytes, hang_up: bool = False) -> threading.Thread:
    """A simulated QEMU that sends this text after any command, and then nothing."""
    listener = socket.socket(socket.AF_UNIX)
    listener.bind(str(path))
    listener.listen()

    def serve() -> None:
        with listener, listener.accept()[0] as far:
            far.sendall(said)
            while not hang_up and far.recv(4096):
                pass

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    return thread


def test_commands_and_events(tmp_path: pathlib.Path) -> None:
    reset = b'{"event": "STOP"}\n{"event": "RESET"}\n'
    thread = monitor(tmp_path / "qmp", GREETING + DONE + b'{"event": "RESUME"}\n' + DONE + reset)
    with Monitor(tmp_path / "qmp") as one:
        one.execute("cont")
        one.wait_for("RESET")
    thread.join()


def test_an_error_is_reported(tmp_path: pathlib.Path) -> None:
    monitor(tmp_path / "qmp", GREETING + DONE + b'{"error": {"desc": "no such thing"}}\n')
    with Monitor(tmp_path / "qmp") as one, pytest.raises(Failed, match="frob: .*no such thing"):
        one.execute("frob")


def test_silence_is_an_error(tmp_path: pathlib.Path) -> None:
    monitor(tmp_path / "silent", b"")
    with pytest.raises(Failed, match="nothing came"):
        Monitor(tmp_path / "silent", 0.1)
    monitor(tmp_path / "qmp", GREETING + DONE + b'{"event": "STOP"}\n')
    with Monitor(tmp_path / "qmp", 0.1) as one, pytest.raises(Failed, match="RESET: nothing came"):
        one.wait_for("RESET")


def test_a_qemu_that_exits_is_noticed(tmp_path: pathlib.Path) -> None:
    monitor(tmp_path / "qmp", GREETING, hang_up=True)
    with pytest.raises(Failed):
        Monitor(tmp_path / "qmp")


def test_a_qemu_that_does_not_listen_yet_is_awaited(image: pathlib.Path, tmp_path: pathlib.Path,
                                                    monkeypatch: pytest.MonkeyPatch) -> None:
    """QEMU makes the socket's name, and listens after that."""
    with socket.socket(socket.AF_UNIX) as early:
        early.bind(str(tmp_path / "qmp"))
        with pytest.raises(NotListening):
            Monitor(tmp_path / "qmp")
    tried: list[pathlib.Path] = []

    class Late(Monitor):
        def __init__(self, path: pathlib.Path, patience: float = PATIENCE) -> None:
            tried.append(path)
            super().__init__(tmp_path / "qmp" if len(tried) < 3 else path, patience)

    monkeypatch.setattr(qemu, "Monitor", Late)
    with qemu.Guest(image, "tcg", console=False):
        assert len(tried) >= 3


def test_a_tool_that_hangs_is_killed() -> None:
    with pytest.raises(Failed, match="not done after 0 s: sleep"):
        common.run(["sleep", "1000"], timeout=0.1)


@pytest.fixture
def image(tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> pathlib.Path:
    """An image without anything to boot."""
    path = tmp_path / "disk.img"
    path.write_bytes(bytes(1 << 20))
    (tmp_path / "tmp").mkdir()
    monkeypatch.setenv("TMPDIR", str(tmp_path / "tmp"))
    return path


def children() -> set[str]:
    return set(pathlib.Path(f"/proc/self/task/{os.getpid()}/children").read_text().split())


def test_a_guest_that_cannot_start_leaves_no_files(image: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = children()
    with pytest.raises(Failed, match="no-such-card"):
        qemu.Guest(image, "tcg", console=False, extra=("-device", "no-such-card"))
    monkeypatch.setattr(qemu, "PATIENCE", -1.0)  # always too late
    with pytest.raises(Failed):
        qemu.Guest(image, "tcg", console=False)
    assert children() == before
    assert list((image.parent / "tmp").iterdir()) == []


def test_at_most_one_kept_guest_runs(image: pathlib.Path,
                                                                  monkeypatch: pytest.MonkeyPatch) -> None:
    kept: list[qemu.Guest] = []
    monkeypatch.setattr(qemu.Guest, "kept", kept)
    with qemu.Guest(image, "tcg", console=False) as one:
        kept.append(one)
        with qemu.Guest(image, "tcg", console=False) as other:
            assert (one.paused, other.paused) == (True, False)
            kept.append(other)
            one.channel("ttyS0")
            assert (one.paused, other.paused) == (False, True)
            other.channel("ttyS0")
            assert (one.paused, other.paused) == (True, False)
            with qemu.Guest(image, "tcg", console=False):
                assert one.paused and other.paused


STARTER = """
import pathlib, sys, time
from parts.guest import qemu
guest = qemu.Guest(pathlib.Path(sys.argv[1]), "tcg", console=False)
print(guest.process.pid, flush=True)
time.sleep(1000)
"""


def test_qemu_is_killed_with_its_starter(image: pathlib.Path) -> None:
    with subprocess.Popen([sys.executable, "-B", "-c", STARTER, image], stdout=subprocess.PIPE, text=True,
                          env={**os.environ, "PYTHONPATH": str(TOP / "tools")}) as starter:
        assert starter.stdout
        folder = pathlib.Path("/proc") / starter.stdout.readline().strip()
        assert "qemu" in (folder / "cmdline").read_text()
        starter.kill()
    deadline = time.monotonic() + PATIENCE
    while folder.exists() and "State:\tZ" not in (folder / "status").read_text():
        assert time.monotonic() < deadline
        time.sleep(0.02)
