# SPDX-License-Identifier: GPL-2.0-or-later
"""`make rollout` onto 50 robots: which are written, started and waited for, and in which order. A robot is a folder
and a script in the place of ssh; tests/host/test_update.py has the real answers of `ddxctl update status --json`."""
from __future__ import annotations

import io
import pathlib
import tarfile

import pytest

import rollout
from parts.common import BadInput, Failed
from parts.release.update_file import Release, manifest
from rollout import Robot, Rollout, Status

pytestmark = pytest.mark.retry

NEW = Release("test", "1", "0.3.0 (new)", "2000")
# Each robot has a file `fate`: kept or returned, for the next trial, or lost: it does not answer. A trial begins with a
# restart, during which the robot does not answer, and is looked at twice.
SSH = r"""#!/bin/sh
while [ "$1" = -o ]; do shift 2; done
name=${1#root@}
cd "$FLEET/$name" || exit 255
note() { echo "$name $1" >> "$FLEET/log"; }
get() { read -r value < "$1"; }
get fate
fate=$value
[ "$fate" != lost ] || { echo "ssh: connect to host $name port 22: No route to host" >&2; exit 255; }
get looks
looks=$value
case "$2" in
	'ddxctl update -')
		note writes
		[ "$fate" != refuses ] || { echo "ddxupdate: the signature is wrong" >&2; exit 2; }
		cat > file
		cmp -s file "$FLEET/new.update" || exit 1
		echo '{"version":"0.3.0 (new)","serial":2000}' > other
		note written
		;;
	'ddxctl update start')
		note start
		echo 3 > looks
		echo "slot B is started next: version 0.3.0 (new)"
		[ "$fate" != cut ] || exit 255
		;;
	'ddxctl update status --json')
		get here; here=$value
		get other; other=$value
		get last; last=$value
		slots="\"A\":$here,\"B\":$other"
		case "$looks" in
			0) ;;
			3) echo 2 > looks; exit 255 ;;
			2) echo 1 > looks; running=B last=trial ;;
			1)
				echo 0 > looks
				if [ "$fate" = returned ]; then
					last=returned
				else
					last=kept
					echo B > slot
				fi
				echo $last > last
				note $last
				;;
		esac
		get slot; running=${running:-$value}
		reason=''
		[ "$last" != returned ] || reason="SSH does not answer"
		echo "{\"running\":\"$running\",\"chosen\":\"$running\",\"last\":\"$last\",\"reason\":\"$reason\"," \
			"\"trial\":\"\",\"slots\":{$slots}}"
		;;
	*) exit 2 ;;
esac
"""


class Fleet:
    def __init__(self, folder: pathlib.Path, count: int) -> None:
        self.folder, self.names = folder, [f"robot{number}" for number in range(1, count + 1)]
        for name in self.names:
            (folder / name).mkdir()
            for file, text in {"fate": "kept", "looks": "0", "slot": "A", "last": "none", "other": "null",
                               "here": '{"version":"0.2.0 (running)","serial":1000}'}.items():
                self.set(name, file, text)
        content = manifest(NEW, bytes(1 << 20))
        with tarfile.open(folder / "new.update", "w", format=tarfile.USTAR_FORMAT) as tar:
            entry = tarfile.TarInfo("manifest")
            entry.size = len(content)
            tar.addfile(entry, io.BytesIO(content))

    def set(self, name: str, file: str, text: str) -> None:
        (self.folder / name / file).write_text(f"{text}\n")

    def run(self) -> list[str]:
        """The lines that the robots have noted in this call."""
        log = self.folder / "log"
        log.write_text("")
        try:
            Rollout(self.folder / "new.update", [Robot(name) for name in self.names], self.folder / "output",
                    pause=0.01).run()
        finally:
            self.log = log.read_text().splitlines()
        return self.log

    def failure(self) -> str:
        with pytest.raises(Failed) as caught:
            self.run()
        return str(caught.value)

    def noted(self, what: str) -> list[str]:
        """The robots that have noted this, in the order of the list."""
        found = {line.split()[0] for line in self.log if line.split()[1] == what}
        return [name for name in self.names if name in found]


@pytest.fixture(name="fleet")
def _fleet(tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> Fleet:
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin/ssh").write_text(SSH)
    (tmp_path / "bin/ssh").chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}", prepend=":")
    monkeypatch.setenv("FLEET", str(tmp_path))
    monkeypatch.setenv("DDX_COMMIT", "abc")
    return Fleet(tmp_path, getattr(request, "param", 8))


@pytest.mark.parametrize("fleet", [50], indirect=True)
def test_fifty_robots(fleet: Fleet) -> None:
    """All are written, ten at a time; then each group is started after the one before has kept the version."""
    fleet.set("robot4", "fate", "cut")
    log = fleet.run()
    at = {line: number for number, line in enumerate(log)}
    writing = most = 0
    for line in log:
        writing += {"writes": 1, "written": -1}.get(line.split()[1], 0)
        most = max(most, writing)
    assert 1 < most <= 10
    assert max(at[f"{name} written"] for name in fleet.names) < at["robot1 start"]
    for before, group in ((fleet.names[:1], fleet.names[1:6]), (fleet.names[1:6], fleet.names[6:])):
        kept = max(at.get(f"{name} kept", len(log)) for name in before)
        started = min(at[f"{name} start"] for name in group)
        assert kept < started, f"{group[0]} was started before {before[0]} had kept the version"
    assert len(at) == len(log) == 4 * 50
    assert fleet.run() == []


def test_the_first_return_stops_it(fleet: Fleet) -> None:
    """The next call continues with that robot."""
    fleet.set("robot3", "fate", "returned")
    assert fleet.failure() == "robot3: has taken version 0.3.0 (new) back: SSH does not answer"
    assert fleet.noted("start") == fleet.names[:6] and fleet.noted("written") == fleet.names
    for name in fleet.names[1:6]:  # their trials go on
        fleet.set(name, "looks", "0")
        fleet.set(name, "slot", "A" if name == "robot3" else "B")
    fleet.set("robot3", "fate", "kept")
    fleet.run()
    assert fleet.noted("start") == ["robot3", "robot7", "robot8"] and fleet.noted("written") == []
    assert fleet.log.index("robot3 kept") < fleet.log.index("robot7 start")


def test_a_stopped_call_is_continued(fleet: Fleet) -> None:
    """A robot that is on trial is waited for; what another file has left is written again."""
    fleet.set("robot1", "looks", "2")
    fleet.set("robot1", "other", '{"version":"0.3.0 (new)","serial":2000}')
    fleet.set("robot2", "other", '{"version":"0.3.0 (new)","serial":1999}')
    fleet.run()
    assert fleet.noted("written") == fleet.noted("start") == fleet.names[1:] and fleet.noted("kept") == fleet.names


@pytest.mark.parametrize("fate, said", [
    ("lost", "robot8: ssh: connect to host robot8 port 22: No route to host; call again, or take it off the list"),
    ("refuses", "robot8: ddxupdate: the signature is wrong"),
])
def test_no_robot_is_started_unless_all_are_written(fleet: Fleet, fate: str, said: str) -> None:
    fleet.set("robot8", "fate", fate)
    assert fleet.failure() == said
    assert fleet.noted("start") == [] and fleet.noted("written") == fleet.names[:7]
    fleet.set("robot8", "fate", "kept")
    fleet.run()
    assert fleet.noted("written") == ["robot8"] and fleet.noted("kept") == fleet.names


def test_a_robot_that_never_comes_back(fleet: Fleet, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rollout, "PATIENCE", 0)
    assert fleet.failure() == "no end of the trial of robot1; call again"


@pytest.mark.parametrize("text, said", [
    (None, "there is no file"), ("# none\n\n", "names no robot"), ("a\nb\na # again\n", "a is there twice"),
    ("-oProxyCommand=x\n", "'-oProxyCommand=x' is no name of a robot"), ("a b\n", "'a b' is no name of a robot"),
])
def test_lists_that_are_refused(tmp_path: pathlib.Path, text: str | None, said: str) -> None:
    if text is not None:
        (tmp_path / "robots").write_text(text)
    with pytest.raises(BadInput, match=said):
        rollout.read_robots(tmp_path / "robots")


def test_files_that_are_refused(fleet: Fleet) -> None:
    for name, content in (("none", None), ("text", b"x" * 5000), ("empty.tar", bytes(10240))):
        if content is not None:
            (fleet.folder / name).write_bytes(content)
        with pytest.raises(BadInput, match="there is no file" if content is None else "is no update file"):
            Rollout(fleet.folder / name, [Robot("a")], fleet.folder / "output")


def test_what_counts_as_kept() -> None:
    slots = {"A": {"version": "0.2.0", "serial": 1}, "B": {"version": NEW.version, "serial": 2000}}
    for last, kept in (("kept", True), ("none", True), ("trial", False), ("chosen", False)):
        assert Status("B", "B", last, "", slots).kept(NEW) == kept
    assert not Status("A", "A", "kept", "", slots).kept(NEW)
    assert not Status("B", "A", "returned", "", slots).kept(NEW)  # about to restart
