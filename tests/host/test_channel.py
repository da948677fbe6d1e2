# SPDX-License-Identifier: GPL-2.0-or-later
"""A shell on a terminal behind a socket, as the tools use a guest's."""
from __future__ import annotations

import contextlib
import os
import pathlib
import pty
import select
import socket
import subprocess
import threading
from collections.abc import Iterator

import pytest

from parts.guest.channel import Channel, Timeout

pytestmark = pytest.mark.retry


def relay(far: socket.socket, terminal: int) -> None:
    """Copy in both directions until one side has closed."""
    with far, contextlib.suppress(OSError):
        while True:
            for one in select.select([far, terminal], [], [])[0]:
                if not (data := far.recv(4096) if one is far else os.read(terminal, 4096)):
                    return
                if one is far:
                    os.write(terminal, data)
                else:
                    far.sendall(data)


@pytest.fixture
def shell(tmp_path: pathlib.Path) -> Iterator[Channel]:
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(tmp_path / "console"))
        listener.listen()
        channel = Channel(tmp_path / "console")
        far, _ = listener.accept()
    terminal, inside = pty.openpty()
    process = subprocess.Popen(["sh"], stdin=inside, stdout=inside, stderr=inside, cwd=tmp_path, start_new_session=True)
    os.close(inside)
    thread = threading.Thread(target=relay, args=(far, terminal))
    thread.start()
    try:
        channel.open_shell(60)
        yield channel
    finally:
        channel.close()
        process.kill()
        process.wait()
        thread.join()
        os.close(terminal)


def test_status_and_output_are_those_of_the_command(shell: Channel) -> None:
    assert shell.run("echo one; echo two; false") == (1, "one\ntwo\n")
    assert shell.run("printf '%s' 'a  b\\n'") == (0, "a  b\\n")


def test_a_late_answer_is_not_taken_for_the_next_command_s(shell: Channel, tmp_path: pathlib.Path) -> None:
    with pytest.raises(Timeout):
        shell.run("until [ -e go ]; do sleep 0.01; done; echo late; false", 0.05)
    (tmp_path / "go").touch()
    assert shell.run("echo next") == (0, "next\n")


def test_a_command_without_a_wait_is_run(shell: Channel, tmp_path: pathlib.Path) -> None:
    shell.begin("echo one; touch here")
    assert shell.run("[ -e here ] && echo two") == (0, "two\n")
    assert (tmp_path / "here").exists()


def test_a_guest_that_has_gone_is_reported(tmp_path: pathlib.Path) -> None:
    """At a probe for the shell, where the other end is closed already."""
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(tmp_path / "console"))
        listener.listen()
        channel = Channel(tmp_path / "console")
        listener.accept()[0].close()
    with pytest.raises(Timeout, match="console: the guest has gone"):
        channel.open_shell(5)
    channel.close()
