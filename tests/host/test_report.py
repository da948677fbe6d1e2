# SPDX-License-Identifier: GPL-2.0-or-later
"""`ddxctl report` prints all that developers need, and no passphrase and no key."""
from __future__ import annotations

import pathlib
import re

import pytest

from parts.guest.native_machine import NativeMachine

pytestmark = pytest.mark.retry


def test_a_report_has_all_messages_and_no_secret(root: pathlib.Path, tmp_path: pathlib.Path) -> None:
    with NativeMachine(root, tmp_path) as robot:
        check(robot)


def check(robot: NativeMachine) -> None:
    phrase, panel, key, typed = "the pass phrase", "open sesame, please", "Q" * 40, "R" * 40
    second, unused = "S" * 40, "T" * 40
    robot.wait_until("ddxctl status ddxhealth | grep -q state=running")
    robot.sh(f"printf 'wifi=68616c6c {phrase}\\npanel={panel}\\nconsole=open\\n' > /run/provision")
    robot.sh(f"umask 077; echo {key} > /data/ddx/stream.key; echo {unused} > /data/ddx/unused.key")
    robot.sh(f"mkdir -p /data/more; echo {second} > /data/more/second")
    robot.sh("chown ddxsend /data/ddx/stream.key")
    robot.sh("ddxctl add ddxvideosend.closed port=8020 key=/data/ddx/stream.key interface=lo")
    robot.sh("printf 'enabled=no\\nkey=/data/more/second\\n' > /data/ddx/ddxvideosend.other.conf")
    robot.sh(f"printf 'enabled=yes\\nkey={typed}\\ninterface=lo\\n' > /data/ddx/ddxvideosend.wrong.conf")
    robot.sh("ddxctl start ddxvideosend.wrong || true")
    robot.wait_until(f"ddxctl logs ddxvideosend.wrong | grep -q {typed}")  # the program does print it
    for line in (phrase, panel, key, f"twice {key} and {key}", second, unused, "last words"):
        robot.sh(f"printf '%s\\n' '{line}' >> /run/log/ddxstore/current")
    robot.sh("echo check was fine > /run/log/check.DDXREC; ln -s /data/ddx/stream.key /run/log/link")
    said = robot.sh("ddxctl report")
    for secret in (phrase, panel, key, typed, second, unused):
        assert secret not in said
    assert "\ntwice [removed] and [removed]\n" in said and "last words" in said and "check was fine" in said
    logs = robot.sh("cd /run/log && ls").split()
    titles = ["health", "services", "counters", "items", *(f"messages: {name}" for name in logs if name != "link"),
              "messages: kernel"]
    assert re.findall(r"^==== (.+)$", said, re.MULTILINE) == titles
    for name in ("version ", "SERVICE ", "ddxhealth"):
        assert name in said
    assert robot.sh("ls -A /run | grep -c report || true") == "0"
    assert robot.run("chpst -u ddxlog ddxctl report") == (1, "ddxctl: report: this needs root")
