# SPDX-License-Identifier: GPL-2.0-or-later
"""Requests: `ddxctl set` sends them to the program that writes an item, and programs send them to each other."""
from __future__ import annotations

import signal
import subprocess
import time

import pytest

from .programs import Compiler, Desk, Process, wait_until

pytestmark = pytest.mark.retry


def serve(desk: Desk, compile_client: Compiler, ms: int = 0) -> Process:
    server = desk.start(compile_client("request_client"), "serve", "thing", ms)
    assert server.stdout and server.stdout.readline() == "serves\n"
    return server


def done(server: Process) -> list[str]:
    """Stop the server; return what it has set, in order."""
    server.kill()
    return server.communicate()[0].split()


def test_set_is_a_request(desk: Desk, compile_client: Compiler) -> None:
    server = serve(desk, compile_client)
    for words in [["level=0"], ["level=100", "gain=7"], ["gain=0x3"]]:
        result = desk.run("ddxctl", "set", "thing", *words)
        assert (result.returncode, result.stdout, result.stderr) == (0, "", "")
    assert done(server) == ["level=0", "level=100", "gain=7", "gain=3"]


@pytest.mark.parametrize("words, status, text", [
    (["level=101"], 2, "level: takes a whole number from 0 to 100"),
    (["gain=1", "level=-1"], 2, "level: takes a whole number from 0 to 100"),  # none of them is set
    (["colour=1"], 2, "colour: no such parameter"),
    (["\x1b[31m\x9b=1"], 2, "?[31m??: no such parameter"),  # no control characters are printed
    (["level=high"], 2, "level=high: not name=number"),
    (["level=1.5"], 2, "level=1.5: not name=number"),
    (["level="], 2, "level=: not name=number"),
    (["level"], 2, "level: not name=number"),
    (["level=99999999999999999999"], 2, "level=99999999999999999999: not name=number"),
    (["x" * 40 + "=1"], 2, "x" * 40 + "=1: not name=number"),
    (["level=1"] * 17, 2, "takes 1 to 16 changes at once"),
])
def test_refused_with_the_range_and_nothing_set(desk: Desk, compile_client: Compiler, words: list[str], status: int,
                                                text: str) -> None:
    server = serve(desk, compile_client)
    result = desk.run("ddxctl", "set", "thing", *words)
    assert (result.returncode, result.stderr) == (status, f"ddxctl: thing: {text}\n")
    assert done(server) == []


def test_requests_of_several_programs_are_queued(desk: Desk, compile_client: Compiler) -> None:
    """None is lost, and those of each client are in order."""
    server = serve(desk, compile_client)
    askers = [desk.start(compile_client("request_client"), "ask", "thing", count, name)
              for name, count in [("level", 50), ("gain", 8), ("level", 50)]]
    assert [asker.wait(60) for asker in askers] == [0, 0, 0]
    made = done(server)
    assert sorted(made) == sorted([f"level={i}" for i in range(50)] * 2 + [f"gain={i}" for i in range(8)])
    gains = [word for word in made if word.startswith("gain")]
    assert gains == sorted(gains)


def test_a_request_without_an_answer_times_out(desk: Desk, compile_client: Compiler) -> None:
    server = serve(desk, compile_client)
    server.send_signal(signal.SIGSTOP)
    begin = time.monotonic()
    result = desk.run("ddxctl", "set", "thing", "level=1")
    assert (result.returncode, result.stderr) == (1, "ddxctl: thing: no answer in time\n")
    assert time.monotonic() - begin < 5
    server.send_signal(signal.SIGCONT)
    assert desk.run("ddxctl", "set", "thing", "level=2").returncode == 0


def test_a_client_that_dies_blocks_no_other(desk: Desk, compile_client: Compiler) -> None:
    server = serve(desk, compile_client, 500)  # ms per request; ddxctl waits 3 s for both
    asker = desk.start("ddxctl", "set", "thing", "level=1")
    wait_until(lambda: desk.sequence("thing.request") > 0)
    asker.kill()
    assert desk.run("ddxctl", "set", "thing", "level=2").returncode == 0
    assert done(server)[-1] == "level=2"


def test_a_new_server_does_not_repeat_old_requests(desk: Desk, compile_client: Compiler) -> None:
    former = serve(desk, compile_client)
    assert desk.run("ddxctl", "set", "thing", "level=5").returncode == 0
    assert done(former) == ["level=5"]
    server = serve(desk, compile_client)
    time.sleep(0.3)
    assert done(server) == []


def test_set_writes_the_item_when_no_server_runs(desk: Desk, compile_client: Compiler) -> None:
    assert desk.run(compile_client("sensor_client")).returncode == 0
    server = desk.start(compile_client("request_client"), "serve", "sensor", 0)
    assert server.stdout and server.stdout.readline() == "serves\n"
    assert desk.run("ddxctl", "set", "sensor", "serial=7").returncode == 2  # no such parameter
    done(server)
    wait_until(lambda: desk.run("ddxctl", "set", "sensor", "serial=7").returncode == 0)
    assert "serial" in desk.run("ddxctl", "show", "sensor").stdout


def test_a_request_to_an_item_without_a_server(desk: Desk, compile_client: Compiler) -> None:
    result: subprocess.CompletedProcess[str] = desk.run(compile_client("request_client"), "ask", "nothing", 1, "level")
    assert (result.returncode, result.stdout) == (1, "-95 no program takes requests for it\n")
