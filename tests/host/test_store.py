# SPDX-License-Identifier: GPL-2.0-or-later
"""The store's tools, its example, and programs of two word sizes with one store."""
from __future__ import annotations

import contextlib
import itertools
import json
import os
import pathlib
import random
import re
import shutil
import signal
import socket
import struct
import subprocess
from collections.abc import Iterator

import pytest

import gate
from parts.image import native

from .programs import ROOT, TOP, Compiler, Desk, library_folder, send_signal, stop, wait_until

pytestmark = pytest.mark.retry

BUILT = TOP / "output"


def built(name: str) -> pathlib.Path:
    """ddx in one of the gate's builds, which is made now if the gate has not come to it yet."""
    options = next(options for build, options, _ in gate.BUILDS if build == name)
    native.build(name, options, ["ddx"])
    return BUILT / name / "ddx"


def test_example_of_the_manual(desk: Desk) -> None:
    example = BUILT / "desk/ddx/tests/test-example"
    reader = desk.start(example)  # waits for the item
    wait_until(lambda: pathlib.Path(f"/proc/{reader.pid}/comm").read_text() == "test-example\n")
    assert desk.run(example, "write").returncode == 0
    status, out = reader.wait(60), reader.communicate()[0]
    assert status == 0, desk.errors(reader)
    first, second = (int(line.split(":")[0]) for line in out.splitlines())
    assert first < second


@pytest.mark.parametrize("writer, readers, store", [("desk", "m32", "desk"), ("m32", "desk", "desk"),
                                                    ("m32", "desk", "m32")])
def test_word_sizes_share_a_store(writer: str, readers: str, store: str) -> None:
    """tests/unit/ddx_stress.c: one writer, nine readers, every word of every frame checked."""
    program = {name: built(name) / "tests/test-stress" for name in ("desk", "m32")}
    assert b"ELF 32-bit" in subprocess.run(["file", program["m32"]], capture_output=True, check=True).stdout
    done = subprocess.run([program[writer]], capture_output=True, text=True, timeout=120, check=False,
                          env={**os.environ, "DDX_OTHER_PROGRAM": str(program[readers]),
                               "DDX_STORE_PROGRAM": str(native.built(store, "ddx") / "ddxstore")})
    assert done.returncode == 0, done.stderr


def test_installed_programs_have_no_fault_injection() -> None:
    """The points where tests kill a program (lib/fault.h) are only in the builds for tests."""
    installed = [library_folder() / "libddx.so", ROOT / "bin/ddxstore", ROOT / "bin/ddxctl"]
    for name in (b"ddx_fault", b"DDX_FAULT", b"writer.published"):
        assert name in (BUILT / "desk/ddx/tests/store-with-faults").read_bytes()
        assert [path for path in installed if name in path.read_bytes()] == []


def test_list_and_show(desk: Desk) -> None:
    example = BUILT / "desk/ddx/tests/test-example"
    assert desk.run(example, "write").returncode == 0
    shown = json.loads(desk.run("ddxctl", "show", "position", "--json").stdout)
    assert shown["type"] == "POSITION"
    assert shown["value"]["x"] == 0.5 and shown["value"]["y"] == -0.5
    assert shown["value"]["number"] == shown["sequence"]
    assert "x                        0.5" in desk.run("ddxctl", "show", "position").stdout
    watcher = desk.start("ddxctl", "watch", "position", "-count", "3", "-json")
    wait_until(lambda: '"readers":1,' in desk.run("ddxctl", "list", "--json").stdout)
    assert desk.run(example, "write").returncode == 0
    writes = [json.loads(line) for line in watcher.communicate(timeout=60)[0].splitlines()]
    assert len(writes) == 3
    assert all(later["sequence"] == one["sequence"] + 1 + later["missed"] for one, later in itertools.pairwise(writes))
    listed = json.loads(desk.run("ddxctl", "list", "--json").stdout)
    item = next(item for item in listed["items"] if item["name"] == "position")
    assert item["bytes"] <= item["reserved"] <= listed["reserved"] <= listed["budget"]
    assert "position" in desk.run("ddxctl", "list").stdout


def test_reasons_of_loss_cannot_control_the_terminal(desk: Desk, compile_client: Compiler) -> None:
    assert desk.run(compile_client("request_client"), "lose", "forged", 3, "\x1b[2J\n").returncode == 0
    assert " lost 3 (?[2J? 3)," in desk.run("ddxctl", "stats").stdout


@pytest.mark.parametrize("arguments, status, text", [
    (["show", "nothing"], 1, "ddxctl: nothing: the store has no item of this name"),
    (["show"], 2, "ddxctl: show: needs the name of an item"),
    (["frobnicate"], 2, "ddxctl: frobnicate: unknown command"),
    (["services"], 1, "ddxctl: services: services exist only on the appliance"),
    (["list", "-frobnicate"], 2, "ddxctl: -frobnicate: unknown option"),
    (["list", "-port", "7"], 1, "ddxctl: no store runs here"),
    (["list", "-port", "x"], 2, "ddxctl: x: -port takes a whole number from 1 to 65535"),
])
def test_ddxctl_reports_errors_in_one_line(desk: Desk, arguments: list[str], status: int, text: str) -> None:
    done = desk.run("ddxctl", *arguments)
    assert done.returncode == status
    assert done.stderr.startswith(text) and done.stderr.count("\n") == 1


HELLO = """#!/bin/sh
[ "$1" != -help ] || exec echo "  ${0##*/ctl-} [NAME]  greets"
echo "hello $*"
exit 3
"""


def test_commands_of_other_packages(tmp_path: pathlib.Path) -> None:
    """Programs installed beside ddxctl are its commands, without a store, unless it has a command of that name."""
    program, folder = tmp_path / "bin/ddxctl", tmp_path / "libexec/ddx"
    program.parent.mkdir()
    folder.mkdir(parents=True)
    shutil.copy(ROOT / "bin/ddxctl", program)
    for name in ("ctl-hello", "ctl-list", "ctl-two words", "other"):
        (folder / name).write_text(HELLO)
        (folder / name).chmod(0o755)

    def run(*words: str) -> tuple[int, str, str]:
        done = subprocess.run([program, *words], capture_output=True, text=True, timeout=60, check=False,
                              env={**os.environ, "DDX_DIR": "/nonexistent", "LD_LIBRARY_PATH": str(library_folder())})
        return done.returncode, done.stdout, done.stderr

    assert run("hello", "you", "-json", "a  b") == (3, "hello you -json a  b\n", "")
    status, text, said = run("list")
    assert (status, text) == (1, "") and said.startswith("ddxctl: no store runs here")
    for word in ("../ddx/ctl-hello", "hello/", "two words", "other", "../other", ""):
        assert run(word) == (2, "", f"ddxctl: {word}: unknown command; see ddxctl -help\n")
    status, text, _ = run("-help")
    assert status == 0 and "\nInstalled beside it:\n  hello [NAME]  greets\n" in text
    assert "two words" not in text and "other [NAME]" not in text
    (folder / "ctl-hello").chmod(0o644)
    assert run("hello")[::2] == (1, f"ddxctl: hello: {folder}/ctl-hello: Permission denied\n")


def test_help_lists_all_commands() -> None:
    done = subprocess.run([ROOT / "bin/ddxctl", "-help"], capture_output=True, text=True, timeout=60, check=True)
    words = [path.name.removeprefix("ctl-") for path in (ROOT / "libexec/ddx").glob("ctl-*")]
    assert {"services", "enable", "health", "recordings"} <= set(words)
    lines = done.stdout.splitlines()
    assert [word for word in words if not any(re.match(f"  {word} ", line) for line in lines)] == []
    assert all(len(line) <= 110 for line in lines) and not done.stderr


@pytest.mark.parametrize("arguments, status, text", [
    (["-m", "8Q"], 2, "ddxstore: -m 8Q: not a size"),
    (["-m"], 2, "ddxstore: -m: needs a value"),
    (["--port", "70000"], 2, "ddxstore: -port 70000: not a port"),
    (["nonsense"], 2, "ddxstore: nonsense: unexpected"),
    ([], 1, "ddxstore: a store runs at port 2005 already"),
])
def test_store_reports_errors_in_one_line(desk: Desk, arguments: list[str], status: int, text: str) -> None:
    done = desk.run("ddxstore", *arguments)
    assert done.returncode == status
    assert done.stderr.startswith(text) and done.stderr.count("\n") == 1


def test_store_prints_its_counters(desk: Desk) -> None:
    status, counters = stop(desk.store)
    assert status == 0
    assert counters["instance"] == "ddxstore" and counters["budget"] == 64 << 20


def test_a_budget_that_is_too_small(tmp_path: pathlib.Path) -> None:
    desk = Desk(tmp_path, "16K")
    try:
        done = desk.run(BUILT / "desk/ddx/tests/test-example", "write")
        assert done.returncode == 1
        assert done.stderr == "position: the store's memory budget is used up; give it more with: ddxstore -m\n"
    finally:
        desk.end()


@pytest.fixture
def guarded(tmp_path: pathlib.Path) -> Iterator[Desk]:
    """A store with AddressSanitizer."""
    built("address")
    desk = Desk(tmp_path, store=native.built("address", "ddx") / "ddxstore")
    yield desk
    desk.end()


def test_invalid_messages_from_clients(guarded: Desk) -> None:
    """With random fields, descriptors and layouts in every kind of message, the store and other programs go on."""
    desk = guarded
    path = str(desk.folder / "run/store-2005")
    writer = desk.start(BUILT / "desk/ddx/tests/test-example", "write")
    wait_until(lambda: desk.run("ddxctl", "show", "position").returncode == 0)
    chance = random.Random(2005)
    for _ in range(1000):
        with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as link:
            link.connect(path)
            link.setblocking(False)
            for _ in range(chance.randrange(1, 20)):
                words = [chance.randrange(0, 24), 0, 1, chance.randrange(0, 8), *(chance.choice(
                    [0, 1, 2, 254, 255, 256, 0xffffffff]) for _ in range(5))]
                layout = chance.randbytes(chance.choice([0, 0, 15, 16, 112, 208]))
                name = chance.choice([b"position", b"new", b"", chance.randbytes(64)]).ljust(64, b"\0")
                fields = struct.pack("<10I", *words, chance.choice([len(layout), 0])) + chance.randbytes(56)
                message = fields + name + b"int".ljust(64, b"\0") + layout
                file = os.memfd_create("nonsense")
                try:
                    socket.send_fds(link, [message[:chance.choice([1000, 1000, 100])]], [file] * chance.randrange(0, 4))
                except OSError:
                    break  # disconnected, or slower than we write
                finally:
                    os.close(file)
    assert desk.store.poll() is None
    assert desk.run("ddxctl", "list").returncode == 0
    assert writer.wait(60) == 0
    wait_until(lambda: bool(json.loads(desk.run("ddxctl", "list", "--json").stdout)["clients"] == 0))


def test_many_programs_may_connect_before_the_store_starts(desk: Desk) -> None:
    """600 programs wait for the store; none fails, and each is served."""
    address = str(next((desk.folder / "run").glob("store-*[0-9]")))
    send_signal(desk.store, signal.SIGSTOP)
    with contextlib.ExitStack() as stack:
        for _ in range(600):
            client = stack.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET))
            client.setblocking(False)
            client.connect(address)
        send_signal(desk.store, signal.SIGCONT)
        assert desk.run("ddxctl", "list").returncode == 0
