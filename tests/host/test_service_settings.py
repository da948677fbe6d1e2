# SPDX-License-Identifier: GPL-2.0-or-later
"""Invalid settings of a service are refused with file and line, and no part of them is executed."""
from __future__ import annotations

import functools
import pathlib
import shlex
import subprocess
from collections.abc import Iterator

import pytest

from .appliance import USERS, Appliance, with_service
from .programs import wait_until

pytestmark = pytest.mark.retry

# Maps 64 MiB of shared memory, then allocates 64 MiB, a MiB at a time; writes how many it got, and dies with fewer.
GREEDY = """
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

int main(void) {
    int got = 0;
    char *one = mmap(NULL, 64 << 20, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);

    for (; one != MAP_FAILED && got < 64; got++) {
        one = mmap(NULL, 1 << 20, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
        if (one == MAP_FAILED)
            break;
        memset(one, 1, 1 << 20);
    }
    FILE *most = fopen("/tmp/most", "a");
    fprintf(most, "%d\\n", got);
    fclose(most);
    if (got < 64)
        abort();
    pause();
}
"""
THING = "/usr/libexec/ddx/service thing"
INSTANCES = ["thing", "thing.a", "thing.b"]
FOLDERS = ["data/ddx", "run/settings", "test"]


@pytest.fixture
def appliance(tmp_path: pathlib.Path) -> Iterator[Appliance]:
    """An appliance with a service that runs forever as a user other than root."""
    with with_service(tmp_path) as appliance:
        for folder in FOLDERS:
            (appliance.root / folder).mkdir(parents=True)
        appliance.add("usr/bin/thing", "#!/bin/sh\nexec sleep 1000\n")
        (appliance.root / "etc/default/thing").write_text("enabled=yes\nuser=ddxlog\n")
        yield appliance


def status(appliance: Appliance, instance: str = "thing") -> tuple[int, dict[str, str]]:
    code, text = appliance.run(f"{THING} status {instance}")
    return code, dict(word.split("=") for word in text.split()[1:])


def runs(appliance: Appliance, instance: str) -> bool:
    return status(appliance, instance)[1]["state"] == "running"


def supervise(appliance: Appliance) -> None:
    appliance.start("exec runsvdir -P /run/service")


@pytest.mark.parametrize("folder, line", [
    ("data/ddx", "enabled=off"), ("data/ddx", "enabled=No"), ("run/settings", "enabled=false"), ("test", "enabled="),
    ("data/ddx", "enabled = YES"), ("data/ddx", "once=1"), ("data/ddx", "oom_score_adj=low"),
    ("data/ddx", "oom_score_adj=-1001"), ("data/ddx", "memory_limit=96"), ("data/ddx", "memory_limit=0M"),
    ("data/ddx", "stop_seconds=31")])
def test_an_invalid_value_is_refused_with_file_and_line(appliance: Appliance, folder: str, line: str) -> None:
    file = appliance.root / folder / "thing.conf"
    file.write_text(f"# mine\n{line}\n")
    code, text = appliance.run(f"{THING} start")
    told = f"/{folder}/thing.conf: line 2: {line.replace(' = ', '=')}: "
    assert code == 1 and told in text and text.endswith("FAIL (settings of thing)\n")
    assert not (appliance.root / "run/service/thing").exists()
    assert status(appliance) == (1, {"enabled": "no", "state": "misconfigured", "pid": "-", "restarts": "0"})
    code, text = appliance.run(f"{THING} settings thing")
    assert code == 1 and text.startswith(told)
    file.write_text("# mine\nenabled=yes\n")
    assert appliance.run(f"{THING} start") == (0, "Starting thing: OK\n")


def test_a_program_beyond_its_memory_limit_is_started_again(appliance: Appliance) -> None:
    """The store's memory, which is shared, does not count, and neither does what is only reserved."""
    (appliance.root / "tmp").mkdir()
    (appliance.root / "tmp").chmod(0o777)
    source = appliance.root / "greedy.c"
    source.write_text(GREEDY)
    subprocess.run(["gcc", "-static", "-Wall", "-Werror", source, "-o", appliance.root / "usr/bin/thing"], check=True)
    settings = appliance.root / "data/ddx/thing.conf"
    settings.write_text("memory_limit=16M\n")
    assert appliance.run(f"{THING} start")[0] == 0
    supervise(appliance)
    wait_until(lambda: int(status(appliance)[1]["restarts"]) >= 2)
    most = [int(line) for line in (appliance.root / "tmp/most").read_text().split()]
    assert all(8 <= one < 16 for one in most), most
    settings.write_text("")  # proves that the limit ends it
    assert appliance.run(f"{THING} restart")[0] == 0
    wait_until(lambda: "64" in (appliance.root / "tmp/most").read_text().split())
    wait_until(lambda: runs(appliance, "thing"))


def test_bad_usage_is_not_retried_until_the_next_start(appliance: Appliance) -> None:
    appliance.add("usr/bin/thing", "#!/bin/sh\ncat /tmp/code >> /tmp/starts\nexit $(cat /tmp/code)\n")
    (appliance.root / "tmp").mkdir()
    (appliance.root / "tmp").chmod(0o777)
    code, starts = appliance.root / "tmp/code", appliance.root / "tmp/starts"
    code.write_text("2\n")
    for times in (1, 2):
        appliance.run(f"{THING} start")
        if times == 1:
            supervise(appliance)
        wait_until(lambda: status(appliance)[1]["state"] == "misconfigured")
        assert status(appliance) == (1, {"enabled": "yes", "state": "misconfigured", "pid": "-", "restarts": "0"})
        assert starts.read_text() == "2\n" * times
    code.write_text("1\n")  # proves that the check can fail: any other exit
    appliance.run(f"{THING} start")
    wait_until(lambda: starts.read_text().count("1\n") > 1)
    appliance.run(f"{THING} stop")
    assert status(appliance)[1]["state"] == "stopped"


def test_several_instances_are_stopped_at_once(appliance: Appliance) -> None:
    """Each exits only once all got TERM: stopped one by one, each would be killed after five seconds."""
    appliance.add("usr/bin/thing", "#!/bin/sh\ntrap 'touch /tmp/told.$$; until [ $(ls /tmp | grep -c told) = 3 ]; "
                                   "do usleep 20000; done; touch /tmp/met.$$; exit' TERM\n"
                                   "touch /tmp/ready.$$\nwhile :; do usleep 20000; done\n")
    (appliance.root / "tmp").mkdir()
    (appliance.root / "tmp").chmod(0o777)
    for instance in INSTANCES[1:]:
        (appliance.root / f"data/ddx/{instance}.conf").write_text("enabled=yes\n")
    appliance.run(f"{THING} start")
    supervise(appliance)
    for instance in INSTANCES:
        wait_until(functools.partial(runs, appliance, instance))
    wait_until(lambda: len(list((appliance.root / "tmp").glob("ready.*"))) == 3)  # the TERM handlers are set
    assert appliance.run(f"{THING} stop") == (0, "Stopping thing: OK\n")
    assert len(list((appliance.root / "tmp").glob("met.*"))) == 3
    assert [status(appliance, one)[1]["state"] for one in INSTANCES] == ["stopped"] * 3


def test_a_service_has_its_seconds_to_stop(appliance: Appliance) -> None:
    """Of several instances, the longest time counts. One that does not exit is killed."""
    appliance.add("usr/bin/thing", "#!/bin/sh\ntrap 'sleep $1; exit' TERM\ntouch /tmp/ready.$$\n"
                                   "while :; do usleep 20000; done\n")
    (appliance.root / "tmp").mkdir()
    (appliance.root / "tmp").chmod(0o777)
    for instance, needed in zip(INSTANCES, ("0", "2", "0")):
        (appliance.root / f"data/ddx/{instance}.conf").write_text(f"enabled=yes\nargument={needed}\nstop_seconds=1\n")
    for seconds, said in (("1", "KILLED"), ("4", "OK")):
        with (appliance.root / f"data/ddx/{INSTANCES[1]}.conf").open("a") as file:
            file.write(f"stop_seconds={seconds}\n")
        for old in (appliance.root / "tmp").glob("ready.*"):
            old.unlink()
        appliance.run(f"{THING} start")
        if said == "KILLED":
            supervise(appliance)
        wait_until(lambda: len(list((appliance.root / "tmp").glob("ready.*"))) == 3)  # the TERM handlers are set
        assert appliance.run(f"{THING} stop") == (0, f"Stopping thing: {said}\n")


@pytest.mark.parametrize("folder", FOLDERS)
def test_only_the_image_sets_the_user(appliance: Appliance, folder: str) -> None:
    """Otherwise the right to write settings, or a disk, would give root's rights."""
    (appliance.root / folder / "thing.conf").write_text("user=root\n user = ddxhealth\r\n")
    text = appliance.run(f"{THING} start")[1]
    supervise(appliance)
    for line in (1, 2):
        assert f"/{folder}/thing.conf: line {line}: user= is allowed only in the image's file, ignored\n" in text
    wait_until(lambda: appliance.run("pidof sleep")[0] == 0)
    assert appliance.run("stat -c %u /proc/$(pidof sleep)") == (0, f"{USERS['ddxlog']}\n")


COMMANDS = ["$(touch /x)", "`touch /x`", "';touch /x;'", '";touch /x;"', "a'\\''touch /x", "\\", "& > /x | * ~ $HOME"]


def test_no_value_is_executed(appliance: Appliance) -> None:
    """The program gets each value as written, and root's shell executes nothing of it."""
    appliance.add("usr/bin/thing", "#!/bin/sh\nprintf '%s\\n' \"$@\" > /tmp/new && mv /tmp/new /tmp/words\n"
                                   "exec sleep 1000\n")
    (appliance.root / "tmp").mkdir()
    (appliance.root / "tmp").chmod(0o777)
    settings = [f"key{number}={text}\n" for number, text in enumerate(COMMANDS)]
    (appliance.root / "data/ddx/thing.a.conf").write_text("enabled=yes\nargument=$(touch /x)\n" + "".join(settings))
    assert appliance.run(f"{THING} start thing.a") == (0, "Starting thing: OK\n")
    supervise(appliance)
    words = appliance.root / "tmp/words"
    wait_until(words.exists)
    wanted = [word for number, text in enumerate(COMMANDS) for word in (f"-key{number}", text)]
    assert words.read_text().splitlines() == ["$(touch /x)", "-instance", "thing.a", *wanted]
    assert not (appliance.root / "x").exists()


@pytest.mark.parametrize("folder", ["etc/default", *FOLDERS])
def test_settings_used_by_root_have_a_strict_form(appliance: Appliance, folder: str) -> None:
    """In every file; a service with another form is not started, and root executes nothing of it."""
    file = appliance.root / folder / ("thing" if folder == "etc/default" else "thing.conf")
    before = file.read_text() if file.exists() else ""
    for text in ("mounted=$(touch /x)", 'mounted=/";touch /x;"', "mounted=/rec\\", "mounted=rec", "needs=`touch /x`",
                 "priority=5 -u root", "priority=20", "realtime=-p", "realtime=0"):
        file.write_text(f"{before}{text}\n")
        code, said = appliance.run(f"{THING} start")
        assert not (appliance.root / "run/service/thing").exists(), text
        told, result = said.splitlines()
        assert (code, result) == (1, "FAIL (settings of thing)")
        assert f"{file.name}: line {before.count(chr(10)) + 1}: {text}: a " in told and told.endswith(" is needed")
    file.write_text(f"{before}mounted=/rec\nneeds=/dev/null\npriority=-20\nrealtime=99\n")
    assert appliance.run(f"{THING} start") == (0, "Starting thing: OK\n")


def test_an_invalid_name_of_an_instance(appliance: Appliance) -> None:
    for name in ("thing.$(touch /x)", "thing.a b", "thing.", "thing.a.b", "thing/../x", "other", "-x"):
        code, text = appliance.run(f"{THING} start '{name}'")
        assert (code, text) == (2, f"/usr/libexec/ddx/service: '{name}' is not a name for an instance of thing\n")
    assert list((appliance.root / "run/service").iterdir()) == []


def test_add_takes_settings_only(appliance: Appliance) -> None:
    """A setting that `service` would ignore is refused, and no file is left."""
    appliance.install("package/ddxservice/control", "usr/libexec/ddx/control")
    appliance.add("etc/init.d/S50thing", "")
    appliance.add("usr/bin/thing", "#!/bin/sh\necho '  -instance NAME'\n")
    assert appliance.run("mount -t tmpfs none /data && mkdir /data/ddx")[0] == 0
    words = ["na me=x", "name=a\tb", "name=a\nuser=root", "name=\33[2J", "n.a=x", "user=root", "help=", "name", "=x"]
    for word in words:
        assert appliance.run(f"/usr/libexec/ddx/control add thing.a {shlex.quote(word)}") == (
            2, f"ddxctl: '{word}' is not key=value, or no setting of an instance\n")
    assert appliance.run("/usr/libexec/ddx/control add thing.a priority=99")[0] == 2
    assert appliance.run(f"/usr/libexec/ddx/control add thing.{'a' * 249} name=x")[0] == 1
    assert appliance.run("ls -A /data/ddx /run/service; ls -A /run")[1].split() == [
        "/data/ddx:", "/run/service:", "log", "service", "settings"]
