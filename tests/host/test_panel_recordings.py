# SPDX-License-Identifier: GPL-2.0-or-later
"""The panel's page of recordings, in Chromium, while the machine records."""
from __future__ import annotations

import json
import pathlib
from typing import Any

import pytest

from parts.guest import panel
from parts.guest.native_machine import NativeMachine
from parts.guest.panel import PASSPHRASE, Visitor

pytestmark = pytest.mark.retry


def recordings(robot: NativeMachine) -> list[dict[str, Any]]:
    return [json.loads(line) for line in robot.sh("ddxctl recordings list --json").splitlines()]


def button(name: str, text: str) -> str:
    """The button of a recording's card that begins with this text."""
    return (f"[...document.querySelectorAll('#recording-{name} button')]"
            f".find((one) => one.textContent.startsWith('{text}'))")


def test_a_recording_is_split_verified_and_deleted(root: pathlib.Path, tmp_path: pathlib.Path) -> None:
    with panel.filming(root, tmp_path / "machine") as robot, Visitor(
            robot, tmp_path / "browser", panel.certificate(robot)) as visitor:
        robot.wait_until("ddxctl recordings | grep -q ' recording$'")
        visitor.open()
        visitor.sees("document.getElementById('passphrase')")
        visitor.logs_in(PASSPHRASE)
        visitor.sees("document.querySelector('a[href=\"#recordings\"]')")
        visitor.taps("document.querySelector('a[href=\"#recordings\"]')")
        first = str(recordings(robot)[-1]["recording"])
        visitor.sees(f"document.getElementById('recording-{first}').innerText.includes('recording')")
        assert visitor.browser.value(f"{button(first, 'Delete')} === undefined")  # not while it is being recorded
        visitor.taps("[...document.querySelectorAll('button')].find((one) => one.textContent === 'Split')")
        visitor.sees(button(first, "Verify"))
        visitor.taps(button(first, "Verify"))
        visitor.reads("verify: good. ")
        visitor.taps(button(first, "Copy"))
        visitor.reads("no USB stick is plugged in")
        visitor.taps(button(first, "Delete"))
        visitor.sees(button(first, f"Delete {first}: it cannot be fetched any more"))
        assert first in [one["recording"] for one in recordings(robot)]
        visitor.taps(button(first, "Delete"))
        visitor.sees(f"!document.getElementById('recording-{first}')")
        assert first not in [one["recording"] for one in recordings(robot)]
        visitor.taps("document.getElementById('record-stop')")
        assert recordings(robot)[-1]["state"] == "recording"
        visitor.taps("document.getElementById('record-stop')")
        robot.wait_until("! ddxctl recordings | grep -q ' recording$'")
        visitor.taps("[...document.querySelectorAll('button')].find((one) => one.textContent === 'Start')")
        robot.wait_until("ddxctl recordings | grep -q ' recording$'")
