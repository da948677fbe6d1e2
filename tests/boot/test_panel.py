# SPDX-License-Identifier: GPL-2.0-or-later
"""A machine with `panel=` in ddx.txt and a closed console, as a technician meets it: what the console shows, the page's
requests, the processes, the name in the network, restart and power off."""
import contextlib
import http.client
import json
import pathlib
import re
import ssl
import struct
from collections.abc import Iterator

import pytest

from lib import mdns
from lib.figures import Figure
from parts.common import PATIENCE, Failed, run, wait_until
from parts.guest.laptop import forward, free_port
from parts.guest.panel import PASSPHRASE, Phone, Visitor
from parts.guest.qemu import Boot, Guest

from .networked import Robot
from .outsider import IP4, IPV4, UDP, Outsider, ethernet, ip
from .test_budget import COUNTED
from .test_ports import outsider as outsider  # a fixture

pytestmark = [pytest.mark.retry, pytest.mark.long]

NAME, GIVEN, SECOND = "robot1", "10.0.2.15", "10.0.0.9"
PROVISION = f'hostname={NAME}\nnetwork=eth0 dhcp\nnetwork=eth1 10.0.0.1/24\npanel="{PASSPHRASE}"\n'
GROUP_MAC = bytes.fromhex("01005e0000fb")
GROUP = bytes([224, 0, 0, 251])
SECONDS, SHARE = 60, 0.05  # of a processor, which the health page may take at most
LOG = "ddxlog"  # a service that is off until it is switched on
PARTS = {"lighttpd": ("916", "65534"), "mdnsd": ("917", "65534"), "ddxpanel": ("915", "900")}


def shown(guest: Guest) -> str:
    """The certificate's SHA-256 that the console shows with the address of the card for SSH."""
    lines = rf"DDXVIDEO: panel: https://{GIVEN}/\r?\n(?:DDXVIDEO: panel: https://.*\n)*" \
            r"DDXVIDEO: panel: certificate, SHA-256: ([0-9A-F:]{95})\r?\n"
    found: list[str] = []

    def said() -> bool:
        found[:] = re.findall(lines, guest.log.read_text(errors="replace"))
        return bool(found)

    guest.wait_for_log(f"panel: https://{GIVEN}/".encode())
    wait_until(said, "the console does not show the certificate", 0.5, PATIENCE)
    return found[-1]


def asks(outsider: Outsider, wanted: list[str]) -> None:
    """Ask the network for the machine's address until the answer is this one."""
    content = mdns.question(f"{NAME}.local", "A")
    header = struct.pack("!HHHH", mdns.PORT, mdns.PORT, 8 + len(content), 0)
    frame = ethernet(GROUP_MAC, IP4, ip(IPV4, GROUP, UDP, header + content))

    def answered() -> bool:
        outsider.send(frame)
        for answer in outsider.receive(1):
            if answer[:6] == GROUP_MAC and answer[12:14] == struct.pack("!H", IP4) and answer[23] == UDP:
                if mdns.records(answer[42:]).get((f"{NAME}.local", "A")) == wanted:
                    return True
        return False

    wait_until(answered, f"{NAME}.local is not at {wanted}", 0.1, PATIENCE)


@pytest.fixture
def place(tmp_path: pathlib.Path) -> Iterator[pathlib.Path]:
    run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-C", "mine", "-f", tmp_path / "mine"])
    yield tmp_path


def test_a_technician_without_a_console(boot: Boot, place: pathlib.Path, outsider: Outsider) -> None:
    ssh, https = free_port(), free_port()
    network = (*forward(ssh, https), *outsider.card())
    provision = PROVISION + f"ssh_key={(place / 'mine.pub').read_text()}"
    with boot("panel", console=False, provision=provision, keep=place, extra=network) as guest:
        digest = shown(guest)
        assert f"DDXVIDEO: panel: https://{NAME}.local/" in guest.log.read_text(errors="replace")
        robot = Robot(guest, ssh, place)
        assert digest in robot.ssh("ddxctl panel").stdout
        phone = Phone(https, NAME, digest)
        with pytest.raises(Failed, match="certificate is"):
            Phone(https, NAME, digest[::-1]).ask("GET", "/panel/session")
        assert phone.ask("GET", "/panel/session")[0] == 401
        assert phone.ask("POST", "/panel/login", "a wrong guess, sorry")[0] == 401
        wait_until(lambda: phone.ask("POST", "/panel/login", PASSPHRASE)[0] == 200, "no login", 0.5, PATIENCE)
        assert NAME in phone.ask("GET", "/panel/session")[1]
        toggle(phone, robot)
        rights(robot)
        asks(outsider, ["10.0.0.1"])
        before = robot.ssh("pidof mdnsd").stdout
        assert robot.ssh(f"ip addr del 10.0.0.1/24 dev eth1; ip addr add {SECOND}/24 dev eth1").returncode == 0
        wait_until(lambda: robot.ssh("pidof mdnsd").stdout not in ("", before), "the same mdnsd", 0.5, PATIENCE)
        asks(outsider, [SECOND])
        guest.wait_for_log(f"panel: https://{SECOND}/".encode())
        leave(phone, "restart")
        guest.process.wait(PATIENCE)  # QEMU exits instead of a reset
        assert "reboot: Restarting system" in guest.log.read_text(errors="replace")
    with boot("panel-again", keep=place, extra=network) as guest:
        assert shown(guest) == digest  # kept in /data
        assert phone.ask("GET", "/panel/session")[0] == 401
        assert phone.ask("POST", "/panel/login", PASSPHRASE)[0] == 200
        leave(phone, "off")
        guest.process.wait(PATIENCE)
        assert "reboot: Power down" in guest.log.read_text(errors="replace")


def test_a_clock_of_1970(boot: Boot, tmp_path: pathlib.Path) -> None:
    """Certificate, login, the limit of guesses and sessions do not depend on the machine's time."""
    https = free_port()
    with boot("panel-1970", provision=PROVISION, extra=(*forward(free_port(), https), "-rtc",
                                                        "base=1970-01-01T00:00:10")) as guest:
        guest.shell()
        assert guest.sh("date -u +%Y") == "1970"
        guest.wait_until("ddxctl panel")
        phone = Phone(https, NAME, guest.sh("ddxctl panel").rpartition("SHA-256: ")[2])
        assert phone.ask("POST", "/panel/login", "a wrong guess, sorry")[0] == 401
        assert phone.ask("POST", "/panel/login", PASSPHRASE)[0] in (200, 429)
        wait_until(lambda: phone.ask("POST", "/panel/login", PASSPHRASE)[0] == 200, "no login", 0.5, PATIENCE)
        assert NAME in phone.ask("GET", "/panel/session")[1]
        (tmp_path / "shown.pem").write_text(ssl.get_server_certificate(("127.0.0.1", https)))
        valid = run(["openssl", "x509", "-in", tmp_path / "shown.pem", "-noout", "-dateopt", "iso_8601", "-dates"])
        assert re.findall(r"=(\d{4}-\d\d-\d\d) ", valid) == ["2019-01-01", "2049-12-31"]
        # A step to the present ends no session.
        guest.sh("date -u -s '2026-03-01 12:00:00'")
        assert any("ddxstore" in line for line in phone.order("services"))
        guest.poweroff()


def busy(guest: Guest) -> float:
    """Seconds of processor time in SECONDS of the guest's time, of all programs."""
    command = "cat /proc/uptime"
    begin, end = (tuple(map(float, guest.sh(one).split())) for one in (command, f"sleep {SECONDS}; {command}"))
    return (end[0] - begin[0]) - (end[1] - begin[1])


def test_what_the_health_page_costs(boot: Boot, tmp_path: pathlib.Path, record_property: Figure) -> None:
    """In seconds of 500 million instructions. A browser in the host's network has the health page open."""
    https = free_port()
    with boot("panel-cost", provision=PROVISION, accel="tcg,thread=single",
              extra=(*COUNTED, *forward(free_port(), https))) as guest:
        guest.shell()
        guest.wait_until("[ -e /run/late.done ] && ddxctl panel && ! pidof slot-came-up")
        shown = ssl.PEM_cert_to_DER_cert(ssl.get_server_certificate(("127.0.0.1", https)))
        no_session = busy(guest)
        with Visitor(None, tmp_path / "browser", shown) as visitor:
            visitor.open(f"https://127.0.0.1:{https}/")
            visitor.enters("health")
            visitor.reads("checked now")
            page = busy(guest)
            visitor.reads("checked")
        record_property("health_page", {f"ms_in_{SECONDS}_s": round((page - no_session) * 1000)})
        assert page - no_session < SECONDS * SHARE


def leave(phone: Phone, word: str) -> None:
    """The panel may be stopped before its answer is here; the console shows what the machine did."""
    with contextlib.suppress(Failed, OSError, http.client.HTTPException):
        phone.order("machine", word)


def toggle(phone: Phone, robot: Robot) -> None:
    """A service switched on and off, seen in /data and in the processes."""
    for word, found in (("enable", True), ("disable", False)):
        phone.order(word, LOG)
        assert robot.ssh(f"cat /data/ddx/{LOG}.conf").stdout.strip().endswith("yes" if found else "no")
        wait_until(lambda: (robot.ssh(f"pidof {LOG}").returncode == 0) == found, f"{word}: processes", 0.5, PATIENCE)
        lines = [json.loads(line) for line in phone.order("services")]
        assert next(line for line in lines if line["name"] == LOG)["enabled"] is found


def rights(robot: Robot) -> None:
    """User, group, no further group, no capability, and no way to get one; nothing to see in the folders of others."""
    said = robot.ssh("main=$(cat /run/service/ddxpanel/supervise/pid); for p in $(pgrep -P $main); do "
                     "readlink /proc/$p/exe > /dev/null || continue; "  # an order that has been executed
                     "awk '/Name|Uid|Gid|Groups|CapPrm|CapEff|CapBnd|CapAmb|NoNewPrivs/ { printf \"%s,\", $2 } "
                     "END { print \"\" }' /proc/$p/status; done").stdout
    parts = {line.split(",")[0]: line.split(",")[1:] for line in said.splitlines()}
    assert {name: tuple(fields[:3]) for name, fields in parts.items()} == {
        name: (user, group, "") for name, (user, group) in PARTS.items()}
    for fields in parts.values():
        assert [int(fields[at], 16) for at in (3, 4, 6)] == [0, 0, 0] and fields[7] == "1"
    for name in ("lighttpd", "mdnsd"):
        for folder in ("rec", "data", "run/ddx"):
            assert robot.ssh(f"ls -A /{folder}").stdout, folder
            assert robot.ssh(f"ls -A /proc/$(pidof {name})/root/{folder}").stdout == "", (name, folder)
    mine = robot.ssh("awk '/CapBnd/ { print $2 }' /proc/1/status").stdout  # proves that the check can fail
    assert int(mine, 16) != 0
