# SPDX-License-Identifier: GPL-2.0-or-later
"""The panel of a machine in namespaces, in Chromium and by hostile requests."""
from __future__ import annotations

import json
import pathlib
import re
import sys
from collections.abc import Iterator

import pytest

from parts.common import MORTAL, run
from parts.guest import panel
from parts.guest.native_machine import NativeMachine
from parts.guest.panel import OWN, PASSPHRASE, Request, Visitor

pytestmark = pytest.mark.retry

LOG = "ddxlog"  # a service that is off until a visitor switches it on
SWITCH = f"document.querySelector('#service-{LOG} [role=switch]')"


@pytest.fixture
def robot(root: pathlib.Path, tmp_path: pathlib.Path) -> Iterator[NativeMachine]:
    with NativeMachine(root, tmp_path / "machine") as machine:
        yield machine


def state(robot: NativeMachine, name: str) -> dict[str, object]:
    lines = [json.loads(line) for line in robot.sh("ddxctl services --json").splitlines()]
    return next(line for line in lines if line["name"] == name)


def test_a_technician_s_visit(robot: NativeMachine, tmp_path: pathlib.Path) -> None:
    """Passphrase, health, services, messages, report, log out; then a link."""
    panel.start(robot)
    shown = panel.certificate(robot)
    assert panel.digest(shown) in robot.sh("ddxctl panel")
    with Visitor(robot, tmp_path / "browser", shown) as visitor:
        visit(robot, visitor)
        visit_by_link(robot, visitor)


def visit(robot: NativeMachine, visitor: Visitor) -> None:
    visitor.open()
    visitor.sees("document.getElementById('passphrase')")
    visitor.logs_in("a wrong guess, sorry")
    visitor.reads("Wrong. Try again in 1 s.")
    robot.sh("sleep 1.1")
    visitor.logs_in(PASSPHRASE)
    visitor.reads("checked now")
    health = robot.run("ddxctl health --json")[1].splitlines()
    titles = [json.loads(line)["title"] for line in health]
    assert visitor.browser.value("document.querySelectorAll('.card').length") == len(titles)
    # Switched on and off, seen in the settings and in the processes.
    visitor.taps("document.querySelector('a[href=\"#services\"]')")
    visitor.sees(SWITCH)
    visitor.taps(SWITCH)
    visitor.sees(f"{SWITCH}.getAttribute('aria-checked') === 'true'")
    assert "enabled=yes" in (robot.keep / f"data/ddx/{LOG}.conf").read_text()
    robot.wait_until(f"ddxctl status {LOG} | grep -q state=running")
    pid = str(state(robot, LOG)["pid"])
    visitor.reads("running")
    visitor.taps(SWITCH)
    visitor.reads("Switch off: nothing is logged")
    assert state(robot, LOG)["enabled"] is True  # nothing yet
    visitor.agrees(SWITCH)
    visitor.sees(f"{SWITCH}.getAttribute('aria-checked') === 'false'")
    assert "enabled=no" in (robot.keep / f"data/ddx/{LOG}.conf").read_text()
    robot.wait_until(f"! kill -0 {pid}")  # the page may see the new setting first
    # A program's output is text, whatever it contains.
    robot.sh(f"echo '<img src=x onerror=\"document.title=1\">&lt;b>' > /run/evil; chown ddxlog /run/evil; "
             f"chpst -u ddxlog sh -c 'cat /run/evil >> /run/log/{LOG}/current'")
    visitor.taps(f"document.querySelector('#service-{LOG} a')")
    visitor.reads("<img src=x onerror=\"document.title=1\">&lt;b>")
    assert visitor.browser.value("document.querySelector('pre img')") is None
    visitor.taps("document.querySelector('a[href=\"#report\"]')")
    visitor.reads("Make the report")
    visitor.taps("document.querySelector('button.main')")
    visitor.reads("Save it as a file")
    report = str(visitor.browser.value("document.querySelector('pre').textContent"))
    assert "DDXVIDEO: report of" in report and "logged in" in report and PASSPHRASE not in report
    assert not report.endswith('"status":0}')
    visitor.taps("document.getElementById('logout')")
    visitor.reads("Logged out.")
    gone = "fetch('/panel/{}', {}).then((answer) => answer.status)"
    order = json.dumps({"method": "POST", "headers": {"X-Panel": "1"}, "body": "health"})
    assert visitor.browser.value(gone.format("session", "{}")) == 401
    assert visitor.browser.value(gone.format("order", order)) == 401


def visit_by_link(robot: NativeMachine, visitor: Visitor) -> None:
    assert "https://localhost/#" in robot.sh("ddxctl panel login")  # the machine has no network
    secret = re.findall(r"#([0-9a-f]{32})$", robot.sh("ddxctl panel login"), re.M)[0]
    visitor.open(f"{panel.ADDRESS}?#{secret}")
    visitor.reads("checked now")
    assert secret not in str(visitor.browser.value("location.href"))
    assert "127.0.0.1: logged in by a link" in robot.sh("ddxctl logs ddxpanel")
    visitor.open(f"{panel.ADDRESS}?again#{secret}")
    visitor.reads("works once")


def test_requests_that_are_refused(robot: NativeMachine) -> None:
    panel.start(robot)
    login = panel.ask(robot, [("POST", "/panel/login", OWN, PASSPHRASE)])[0]
    assert login[0] == 200
    cookie = login[1]["Set-Cookie"]
    for rule in ("__Host-panel=", "; Path=/", "; Secure", "; HttpOnly", "; SameSite=Strict"):
        assert rule in cookie
    inside = {**OWN, "Cookie": cookie.split(";")[0]}

    def order(body: str, **changed: str) -> Request:
        headers = {**inside, **{name.replace("_", "-"): value for name, value in changed.items()}}
        return "POST", "/panel/order", {name: value for name, value in headers.items() if value}, body

    cases: list[tuple[int, Request]] = [
        (200, order("services")), (400, order("reboot")), (400, order("restart\n;reboot")), (400, order("")),
        (400, order("restart\nstore\nmore")), (400, order("health\r\nX: y")), (400, order("machine\n$(reboot)")),
        (403, order("services", Origin="https://evil.example")), (403, order("services", Origin="")),
        (403, order("services", X_Panel="")), (403, order("services", Host="evil.example")),
        (403, order("services", Host="ddxvideo.evil.example")), (200, order("services", Host="ddxvideo.local",
                                                                          Origin="https://ddxvideo.local")),
        (401, order("services", Cookie="")), (401, order("services", Cookie="__Host-panel=" + "0" * 32)),
        (401, order("services", Cookie=f"{inside['Cookie']}; {inside['Cookie']}")),
        (405, ("GET", "/panel/order", inside, "")), (413, order("x" * (70 << 10))),
        (404, ("POST", "/panel/nothing", inside, "")), (400, order("x" * (60 << 10))),
        (404, ("GET", "/../../../etc/passwd", {}, "")), (404, ("GET", "/%2e%2e/%2e%2e/panel.conf", {}, "")),
        (404, ("GET", "/etc/passwd", {}, "")), (200, ("GET", "/", {}, ""))]
    answers = panel.ask(robot, [request for _, request in cases])
    assert [(status, case[1]) for (status, _, _), case in zip(answers, cases)] == [
        (wanted, request) for wanted, request in cases]
    assert "default-src 'none'" in answers[-1][1]["Content-Security-Policy"]
    assert robot.run("pidof runsvdir")[0] == 0
    # Port 80 leads to TLS, and answers nothing else.
    plain = robot.run("wget -S -O /dev/null http://127.0.0.1/panel/session 2>&1")[1]
    assert "301 Moved Permanently" in plain and "Location: https://127.0.0.1/\n" in plain.replace("\r", "") + "\n"


# Each user of the machine (but root) tries to read the keys, and to talk to the web process past the web server.
TRIES = """
import os, socket, sys
os.chroot(sys.argv[1])
os.chdir("/")
for line in open("/etc/passwd"):
    name, _, user, group = line.split(":")[:4]
    for path in sys.argv[2:] if user != "0" else []:
        if os.fork():
            os.wait()
            continue
        os.setgroups([])
        os.setgid(int(group))
        os.setuid(int(user))
        try:
            if path.endswith("scgi"):
                socket.socket(socket.AF_UNIX).connect(path)
            else:
                open(path).read()
            print(name, path, flush=True)
        except PermissionError:
            pass
        os._exit(0)
"""


def reached(robot: NativeMachine) -> list[str]:
    paths = ["/run/panel/scgi", "/run/panel/web.pem", "/data/panel/panel.pem"]
    return run([*MORTAL, sys.executable, "-c", TRIES, f"/proc/{robot.init}/root", *paths]).splitlines()


def test_each_part_has_only_its_rights(robot: NativeMachine) -> None:
    panel.start(robot)
    for part in ("ddxpanel *ddxpanel", "ddxweb *lighttpd"):  # when they have given up root's rights
        robot.wait_until(f"ps -o user,comm | grep -q '{part}'")
    fields = ("/Name|Uid|Gid|Groups|CapPrm|CapBnd|NoNewPrivs/")
    said = robot.sh("main=$(cat /run/service/ddxpanel/supervise/pid); for p in $main $(pgrep -P $main); do "
                    f"awk '{fields} {{ $1 = \"\"; printf \"%s,\", $0 }} END {{ print \"\" }}' /proc/$p/status; done")
    parts = [[one.strip() for one in line.split(",")] for line in said.splitlines()]
    assert [(one[0], one[1].split()[0], one[2].split()[0], one[3], int(one[4], 16), one[6]) for one in parts] == [
        ("ddxpanel", "0", "900", "900", int(parts[0][5], 16), "1"),
        ("ddxpanel", "915", "900", "", 0, "1"), ("lighttpd", "916", "65534", "", 0, "1")]
    server = robot.sh("pgrep lighttpd")
    for folder in ("rec", "data", "run/ddx"):
        assert robot.sh(f"ls -A /{folder}") and not robot.sh(f"ls -A /proc/{server}/root/{folder}"), folder
    assert reached(robot) == ["ddxweb /run/panel/scgi", "ddxweb /run/panel/web.pem"]
    files = "/run/panel /run/panel/scgi /run/panel/web.pem /data/panel/panel.pem"
    assert robot.sh(f"stat -c '%a %U' {files}").splitlines() == ["711 root", "600 ddxweb", "400 ddxweb", "600 root"]
    web = robot.sh("pgrep -P $(cat /run/service/ddxpanel/supervise/pid) ddxpanel")
    assert not robot.sh(f"ls -A /proc/{web}/root/rec /proc/{web}/root/data | grep -v :$ || true")
    # One that is killed or hangs takes the others with it, and all come back.
    robot.sh(f"kill -9 {server}")
    robot.wait_until("ddxctl status ddxpanel | grep -q 'state=running .*restarts=1$'")
    robot.wait_until("[ $(ddxctl logs ddxpanel | grep -c ready) = 2 ]")
    main = robot.sh("cat /run/service/ddxpanel/supervise/pid")
    robot.sh(f"kill -STOP $(pgrep -P {main} ddxpanel)")
    robot.wait_until("ddxctl status ddxpanel | grep -q 'restarts=2$'")
    assert "its web process hangs" in robot.sh("ddxctl logs ddxpanel")
    robot.wait_until("[ $(ddxctl logs ddxpanel | grep -c ready) = 3 ]")
    # Off: no process, no port.
    robot.sh("ddxctl disable ddxpanel")
    robot.wait_until("! pgrep 'ddxpanel|lighttpd'")
    robot.wait_until("! netstat -ltn | grep -q ':443 '")
