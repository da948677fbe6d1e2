# SPDX-License-Identifier: GPL-2.0-or-later
"""launch: starts a service's program with the rights that its file gives, or starts nothing and says why."""
from __future__ import annotations

import pathlib
import re
import signal
from collections.abc import Iterator

import pytest

from .appliance import USERS, Appliance, with_service
from .programs import wait_until

pytestmark = pytest.mark.retry

RUN = "cd /folder && exec ./run"
PROGRAM = "argument=/usr/bin/thing\n"
WHOLE = f"user=ddxlog\ngroup=ddx\n{PROGRAM}end\n"
# The message, with spaces behind it where several files have the same one; None: there is no file.
REFUSED = {
    "cannot be read: No such file or directory": None,
    "is cut: it has no end": WHOLE[:-4],
    "is cut: it has no end ": WHOLE[:-1],
    "is cut: it has no end  ": "",
    "goes on after end": f"{WHOLE}argument=x\n",
    "is contradictory: twice user": f"user=root\n{WHOLE}",
    "has no user": f"group=ddx\n{PROGRAM}end\n",
    "has no value for user": f"user=\n{PROGRAM}end\n",
    "there is no user guest7": f"user=guest7\n{PROGRAM}end\n",
    "there is no group none": f"user=ddxlog\ngroup=none\n{PROGRAM}end\n",
    "has no path of a program": "user=ddxlog\nend\n",
    "has no path of a program ": "user=ddxlog\nargument=thing\nend\n",
    "has an invalid number for nice": f"nice=5x\n{WHOLE}",
    "has an invalid number for realtime": f"realtime=100\n{WHOLE}",
    "has an unknown key color": f"color=red\n{WHOLE}",
    "is not key=value: word": f"word\n{WHOLE}",
    "is too long, or no text": f"user=dd\0xlog\n{PROGRAM}end\n",
    "too many arguments": f"user=ddxlog\n{PROGRAM * 257}end\n",
    "/usr/bin/other: No such file or directory": "user=ddxlog\nargument=/usr/bin/other\nend\n",
}


@pytest.fixture
def appliance(tmp_path: pathlib.Path) -> Iterator[Appliance]:
    """An appliance with a folder whose program reports its rights and its arguments."""
    with with_service(tmp_path) as appliance:
        appliance.add("usr/bin/thing", "#!/bin/sh\ncat /proc/self/status /proc/self/oom_score_adj\nnice\nchrt -p $$\n"
                                       "ulimit -d\nprintf '<%s>\\n' \"$@\"\necho trouble >&2\n")
        (appliance.root / "folder").mkdir()
        (appliance.root / "folder/run").symlink_to("/usr/libexec/ddx/launch")
        yield appliance


def write(appliance: Appliance, text: str | None) -> None:
    if text is not None:
        (appliance.root / "folder/launch").write_text(text)


def test_a_program_gets_these_rights_and_no_others(appliance: Appliance) -> None:
    write(appliance, "user=ddxlog\ngroup=ddx\nnice=7\nrealtime=3\noom_score_adj=500\nmemory_limit=67108864\n"
          f"{PROGRAM}argument= a  b \nargument=\nargument=$(touch /x)=`'\nend\n")
    status, text = appliance.run(f"{RUN} 2> /dev/null")  # errors belong to the service's output
    found = dict(re.findall(r"^(\w+):\t(.*?) *$", text, re.M))
    assert status == 0 and found["Uid"].split() == [str(USERS["ddxlog"])] * 4, text
    assert found["Gid"].split() == ["900"] * 4 and found["Groups"] == "900" and found["NoNewPrivs"] == "1"
    assert [int(found[kind], 16) for kind in ("CapInh", "CapPrm", "CapEff", "CapAmb")] == [0] * 4
    rest = text[text.index("\n500\n"):].splitlines()
    assert rest[1:3] == ["500", "7"] and "SCHED_FIFO" in rest[3] and rest[4].endswith(": 3"), rest
    assert rest[5:] == ["65536", "< a  b >", "<>", "<$(touch /x)=`'>", "trouble"]
    uptime = (appliance.root / "folder/begin").read_text()
    assert re.fullmatch(r"\d+\.\d\d \d+\.\d\d\n", uptime)


def test_without_a_group_it_is_the_user_s(appliance: Appliance) -> None:
    write(appliance, f"user=ddxlog\n{PROGRAM}end\n")
    assert "\nGroups:\t0 \n" in appliance.run(RUN)[1]


@pytest.mark.parametrize("reason", REFUSED)
def test_nothing_is_started_by_a_wrong_file(appliance: Appliance, reason: str) -> None:
    write(appliance, REFUSED[reason])
    assert appliance.run(RUN) == (111, f"launch: launch: {reason.strip()}; nothing is started\n")


def test_a_program_waits_for_its_disk_until_it_is_stopped(appliance: Appliance) -> None:
    (appliance.root / "rec").mkdir()
    write(appliance, f"mounted=/rec\n{WHOLE}")
    waiting, begin = appliance.root / "folder/waiting", appliance.root / "folder/begin"
    stopped = appliance.start("cd /folder && { ./run & echo $! > /pid; wait $!; echo $?; }")
    wait_until(waiting.exists)
    assert appliance.run("kill $(cat /pid)")[0] == 0
    said = stopped.communicate(timeout=30)[0].splitlines()
    assert (said[0], said[-1]) == ("waits until there is a disk at /rec", str(128 + signal.SIGTERM))
    assert not begin.exists()
    waiting.unlink()
    goes_on = appliance.start(RUN)
    wait_until(waiting.exists)
    assert appliance.run("mount -t tmpfs none /rec")[0] == 0
    assert "Groups:\t900" in goes_on.communicate(timeout=30)[0]
    assert not waiting.exists() and begin.exists()


def test_a_check_has_the_program_check_its_settings(appliance: Appliance) -> None:
    """With the program's user, at once, and without a trace in the folder."""
    write(appliance, f"mounted=/rec\n{WHOLE}")
    status, text = appliance.run("cd /folder && /usr/libexec/ddx/launch launch -check")
    assert status == 0 and "Groups:\t900" in text and text.endswith("<-check>\ntrouble\n")
    assert sorted(one.name for one in (appliance.root / "folder").iterdir()) == ["launch", "run"]
