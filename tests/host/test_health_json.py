# SPDX-License-Identifier: GPL-2.0-or-later
"""`ddxctl health --json` prints an object for each line, with the technician's action."""
from __future__ import annotations

import json
import pathlib
import re
from collections.abc import Iterator
from typing import Any

import pytest

from parts.common import TOP
from parts.guest.native_machine import NativeMachine

from .appliance import Appliance

pytestmark = pytest.mark.retry

HEALTH = TOP / "package/ddxservice/health"
ACTIONS = TOP / "package/ddxservice/actions"
# Complaints whose text is not in the script `health` as a whole, and examples of them.
VARIES = {"x is x; ddxctl logs x", "x is not mounted; x"}
EXAMPLES = [("service", "ddxdecode is misconfigured; ddxctl logs ddxdecode"),
            ("service", "ddxdecode is stopped; ddxctl logs ddxdecode"),
            ("disk", "/data is not mounted; see /run/log"), ("disk", "/rec is not mounted; it is being checked"),
            ("slot", "the boot partition cannot be mounted, so a slot that cannot be booted may stay the chosen one"),
            ("disk", "/data cannot be used; settings are those of their copy on /rec"),
            ("disk", "settings have no copy: /rec/.ddx/settings cannot be written"),
            ("disk", "/rec: 12 of 2000 MB free"), ("disk", "/data: 1 of 60 MB free"),
            ("recorder", "room for 100 MB, in prepared files and free space, 3 min at this rate; files ready: 2"),
            ("heat", "x86_pkg_temp: 95 C"),
            ("frames", "ddxvideosave: 25.0 in, 20.0 out a second, 17 lost (ring 17)")]


def rows() -> list[tuple[list[str], str]]:
    """The table of docs/technician.md, section 3: messages, and the action as plain text."""
    page = (TOP / "docs/technician.md").read_text()
    table = re.findall(r"^\| (.+) \| (.+) \|$", page.split("## 3. ")[1].split("## 4. ")[0], re.MULTILINE)[1:]
    found = []
    for message, action in table:
        outside = re.sub(r"\([^)]*`[^)]*\)", "", message)  # messages of other programs are in brackets
        plain = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", re.sub(r" \(\d\)", "", action)).replace("`", "")
        found.append(([one for one in re.findall(r"`([^`]+)`", outside) if one != "!"], plain))
    return found


def test_the_actions_are_those_of_the_technician_s_page() -> None:
    wanted = [(re.sub(r"\*+", "*", re.sub(r" ?\.\.\. ?", "*", f"...{one}...")), action)
              for messages, action in rows() for one in messages]
    lines = [tuple(line.split("\t")) for line in ACTIONS.read_text().splitlines()]
    assert len(wanted) > 25 and lines == wanted


def complaints() -> list[tuple[str, str]]:
    """Title and text of each complaint; `x` takes the place of what the script inserts."""
    script = HEALTH.read_text().replace("\\\n", " ")
    found = re.findall(r'complain +("[^"]*"|\S+) +"((?:\$\([^()]*\)|[^"$]|\$)*)"', script)
    plain = [(title.strip('"'), re.sub(r"\$(\{[^}]*\}|\([^)]*\)|\w+)", "x", text)) for title, text in found]
    assert script.count("complain ") - 1 <= len(plain)  # one is in a sentence
    return plain


@pytest.fixture
def appliance(tmp_path: pathlib.Path) -> Iterator[Appliance]:
    appliance = Appliance(tmp_path)
    appliance.install("package/ddxservice/actions", "usr/libexec/ddx/actions")
    text = HEALTH.read_text()
    appliance.add("usr/libexec/ddx/part", text[:text.index("machine() {")])  # the functions that print
    yield appliance
    appliance.end()


def printed(appliance: Appliance, title: str, text: str) -> dict[str, Any]:
    (appliance.root / "text").write_text(text)
    status, said = appliance.run(f"set -- --json; . /usr/libexec/ddx/part; complain '{title}' \"$(cat /text)\"")
    assert status == 0 and said.count("\n") == 1
    return dict(json.loads(said))


def test_each_complaint_has_an_action(appliance: Appliance) -> None:
    known = complaints()
    assert len(known) > 15 and ("service", "x has died; ddxctl logs x") in known
    for title, text in [*known, *EXAMPLES]:
        if text != "x" and text not in VARIES:
            assert printed(appliance, title, text)["action"], (title, text)
    assert printed(appliance, "nothing", "of this kind")["action"] is None


def test_any_text_becomes_json(appliance: Appliance) -> None:
    for text, shown in (('a "quoted" \\ one', 'a "quoted" \\ one'), ("two\nlines\tand\x1b[2J", "two lines?and?[2J"),
                        ("$(reboot) `reboot` '; reboot", "$(reboot) `reboot` '; reboot"), ("M\u00fcller", "M??ller")):
        found = printed(appliance, "ddx.txt", text)
        assert found == {"title": "ddx.txt", "text": shown, "complaint": True,
                         "action": "correct the line in ddx.txt on the card"}


@pytest.fixture(scope="module")
def robot(root: pathlib.Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[NativeMachine]:
    with NativeMachine(root, tmp_path_factory.mktemp("robot")) as machine:
        machine.wait_until("ddxctl status ddxhealth | grep -q state=running")
        yield machine


def test_each_line_is_printed_once_it_is_known(robot: NativeMachine) -> None:
    """While the script waits between two reads of the counters, the lines before are there. A `sleep` in $PATH would
    not help: the image's shell has a builtin."""
    held = 'sleep() { touch /tmp/held; until [ -e /tmp/go ]; do usleep 50000; done; }'
    command = f"({held}; set -- --json; . /usr/libexec/ddx/health) > /tmp/lines; echo $? > /tmp/status"
    robot.sh(f"{{ {command}; }} > /dev/null 2>&1 &")
    robot.wait_until("[ -e /tmp/held ]")
    before = [json.loads(line) for line in robot.sh("cat /tmp/lines").splitlines()]
    assert [one["title"] for one in before][:2] == ["version", "machine"]
    assert [one["title"] for one in before][-2:] == ["services", "services"]
    robot.sh("touch /tmp/go")
    robot.wait_until("[ -s /tmp/status ]")
    lines = [json.loads(line) for line in robot.sh("cat /tmp/lines").splitlines()]
    assert lines[:len(before)] == before and len(lines) > len(before) + 5
    assert {frozenset(one) for one in lines} == {frozenset({"title", "text", "complaint", "action"})}
    camera, = (one for one in lines if one["title"] == "camera")
    assert camera["complaint"] and camera["action"].startswith("plug the camera into another port")
    assert all(one["action"] is None for one in lines if not one["complaint"])
    assert robot.sh("cat /tmp/status") == "1"


def test_the_objects_are_the_lines_of_the_screen(robot: NativeMachine) -> None:
    status, said = robot.run("ddxctl health --json")
    lines = [json.loads(line) for line in said.splitlines()]
    text = robot.run("ddxctl health")[1]
    screen = [re.split(r" {2,}", re.sub("^[ !] ", "", line), maxsplit=1) for line in text.splitlines()]
    assert status == 1 and {title or "services" for title, _ in screen} == {one["title"] for one in lines}
    assert robot.run("ddxctl health --jsn") == (2, "ddxctl: health: unexpected '--jsn'")
