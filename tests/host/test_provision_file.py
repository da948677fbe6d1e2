# SPDX-License-Identifier: GPL-2.0-or-later
"""ddx.txt, read by the machine's awk: valid lines are applied, wrong lines are reported."""
import pathlib
import subprocess

import pytest

import build
from parts.common import OUTPUT, TOP
from parts.image import native

pytestmark = pytest.mark.retry

KEY = "ssh-ed25519 AAAAC3NzaC1lZDI1NTE5AAAAIBkvAbcd+/9 someone@there"


@pytest.fixture(scope="module")
def defaults(tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    build.dev([native.build()])
    folder = tmp_path_factory.mktemp("defaults")
    for name in ("ddxstore", "ddxvideosend"):
        (folder / name).write_text("enabled=yes\n")
    return folder


def read(defaults: pathlib.Path, text: str | bytes) -> tuple[list[str], list[str]]:
    command = [str(OUTPUT / "dev/root/bin/busybox"), "awk", "-v", f"defaults={defaults}",
               "-v", "services=ddxstore ddxvideosend", "-f", str(TOP / "overlay/usr/libexec/ddx/provision.awk")]
    done = subprocess.run(command, input=text.encode() if isinstance(text, str) else text, capture_output=True,
                          check=True)
    return done.stdout.decode().splitlines(), done.stderr.decode().splitlines()


@pytest.mark.parametrize("line", [
    "hostname=robot1", "console=open", "console=closed", f"ssh_key={KEY}", "network=eth0 dhcp",
    "network=enp3s0 192.168.1.5/24", "network=eth1 192.168.1.5/24 192.168.1.1", "dns=192.168.1.1 10.0.0.1",
    "ntp=pool.ntp.org 192.168.1.1", "service=ddxvideosend on", "service=ddxstore off", "test=yes", "test=no"])
def test_a_valid_line_is_taken(defaults: pathlib.Path, line: str) -> None:
    assert read(defaults, line + "\n") == ([line], [])


def test_a_name_before_release_0_3_0_is_the_service_of_today(defaults: pathlib.Path) -> None:
    assert read(defaults, "service=store off\n") == (["service=ddxstore off"], [])


def shown(line: str) -> str:
    """The reported form of a line, without the text after an unknown key, which may be a secret."""
    known = ("console", "country", "dns", "hostname", "network", "ntp", "service", "ssh_key", "test")
    key, equals, _ = line.partition("=")
    if not equals:
        first, space, _ = line.partition(" ")
        return f"{first} ..." if space else first
    return line[:60] if key in known else f"{key}=..."


@pytest.mark.parametrize("line, says", [
    ("hostname=Robot", "small letters"), ("hostname=", "small letters"), ("hostname=" + "x" * 64, "63 at most"),
    ("hostname=a; reboot", "small letters"), ("console=yes", "open or closed"), ("host=robot", "not a key; there are:"),
    ("nonsense", "key=value is needed"), ("=value", "not a key"), ("ssh_key=-----BEGIN OPENSSH PRIVATE KEY", "public"),
    ("network=eth0", "dhcp is needed"), ("network=dhcp", "dhcp is needed"), ("network=", "an interface is needed"),
    ("network=eth0 192.168.1.5", "dhcp is needed"), ("network=eth0 192.168.1.256/24", "dhcp is needed"),
    ("network=eth0 192.168.1.5/33", "dhcp is needed"), ("network=eth0 192.168.1.5/24 gateway", "dhcp is needed"),
    ("network=eth0 dhcp 192.168.1.1", "dhcp is needed"), ("network=../x dhcp", "an interface"),
    ("dns=name", "an address"),
    ("dns=", "an address is needed"), ("ntp=-p", "host's name"), ("ntp=$(reboot)", "host's name"),
    ("service=ddxstore", "on or off"), ("test=1", "yes or no"),
    ("service=stor on", "there is no service 'stor'; there are: ddxstore ddxvideosend"),
    ("service=../etc/passwd on", "there is no service"), ("country=de", "two capital letters"),
    ("country=DEU", "two capital letters"), ("wfi=hall secret123", "not a key"), ("wifi hall secret123", "key=value")])
def test_a_wrong_line_is_reported_and_left_out(defaults: pathlib.Path, line: str, says: str) -> None:
    taken, wrong = read(defaults, f"# first\n{line}\nhostname=robot1\n")
    assert taken == ["hostname=robot1"]
    assert len(wrong) == 1 and wrong[0].startswith(f"ddx.txt, line 2: {shown(line)}: ") and says in wrong[0]


@pytest.mark.parametrize("line, phrase", [
    ("open-sesame-42", "open-sesame-42"), ('"open sesame, please"', "open sesame, please"),
    ('  "two  spaces, a "" and \\ $(reboot)"  ', 'two  spaces, a " and \\ $(reboot)'), ("x" * 12, "x" * 12),
    ("x" * 128, "x" * 128)])
def test_a_passphrase_of_the_panel_is_taken(defaults: pathlib.Path, line: str, phrase: str) -> None:
    assert read(defaults, f"panel={line}\n") == ([f"panel={phrase}"], [])


@pytest.mark.parametrize("line, says", [
    ("open sesame, please", "quotes are needed"), ('"open sesame', "quotes are needed"), ("short", "this one 5"),
    ("", "this one 0"), ("x" * 129, "this one 129"), ("\u201copen sesame, please\u201d", "straight quotes"),
    ("open-sesame-\u00e4", "letters from A to Z"), ("open-sesame\x0142", "invisible")])
def test_a_wrong_passphrase_of_the_panel_is_not_shown(defaults: pathlib.Path, line: str, says: str) -> None:
    taken, wrong = read(defaults, f"panel={line}\n")
    assert taken == [] and len(wrong) == 1
    assert wrong[0].startswith("ddx.txt, line 1: panel=...: ") and says in wrong[0]


def test_the_second_passphrase_of_the_panel_is_refused(defaults: pathlib.Path) -> None:
    taken, wrong = read(defaults, "panel=open-sesame-42\npanel=open-sesame-43\n")
    assert taken == ["panel=open-sesame-42"] and "line 1 has set this already" in wrong[0]


JOIN = "network=wlan0 dhcp"
HEX = "0123456789abcdef" * 3 + "0123456789ABCDEF"


@pytest.mark.parametrize("line, name, phrase", [
    ("hall secret12", "hall", "secret12"), ("  hall   secret12  ", "hall", "secret12"), ("hall open", "hall", "open"),
    ("hall " + "x" * 63, "hall", "x" * 63), (f"hall {HEX}", "hall", HEX),
    ("x" * 32 + " secret12", "x" * 32, "secret12"),
    ('"Robot Hall" "pass phrase"', "Robot Hall", "pass phrase"), ('"Robot Hall" open', "Robot Hall", "open"),
    ('" two  spaces " "  and  more  "', " two  spaces ", "  and  more  "), ("hall a=b#c=d=", "hall", "a=b#c=d="),
    ('"say ""hi""" "8 "" inches"', 'say "hi"', '8 " inches'), ("B\u00fcro secret12", "B\u00fcro", "secret12"),
    ("hall $(reboot);`x`", "hall", "$(reboot);`x`"), ("hall it's\\n%s%d", "hall", "it's\\n%s%d")])
def test_a_wireless_network_is_taken(defaults: pathlib.Path, line: str, name: str, phrase: str) -> None:
    taken, wrong = read(defaults, f"wifi={line}\n{JOIN}\n")
    assert wrong == [] and taken == [f"wifi={name.encode().hex()} {phrase}", JOIN]


@pytest.mark.parametrize("line, says", [
    ("hall", "a passphrase is needed, or"), ("", "a network's name is needed"), ("hall secret1", "8 to 63 characters"),
    ("hall " + "x" * 64, "8 to 63 characters, this one 64"), ('hall "open"', "8 to 63 characters, this one 4"),
    ("x" * 33 + " secret12", "32 bytes"), ("\u00fc" * 17 + " secret12", "32 bytes"), ('"" secret12', "name is needed"),
    ("Robot Hall secret12", "quotes are needed"), ("hall pass phrase", "quotes are needed"),
    ('"Robot Hall secret12', "quotes are needed"), ('"Robot"Hall secret12', "quotes are needed"),
    ('Robot"Hall secret12', "quotes are needed"), ('hall "secret12" more', "quotes are needed"),
    ("\u201cRobot Hall\u201d secret12", "straight"), ("hall geh\u00e4im12", "letters from A to Z"),
    ('hall "secret\t12"', "invisible"), ("hall secret\x0112", "invisible"), ("hall secret12\x7f", "invisible")])
def test_a_wrong_wireless_line_is_reported_without_its_passphrase(defaults: pathlib.Path, line: str, says: str) -> None:
    taken, wrong = read(defaults, f"wifi={line}\nwifi=other secret12\n{JOIN}\n")
    assert taken == [f"wifi={b'other'.hex()} secret12", JOIN]
    assert len(wrong) == 1 and wrong[0].startswith("ddx.txt, line 1: wifi=...: ") and says in wrong[0]


def test_a_wireless_network_and_an_interface_need_each_other(defaults: pathlib.Path) -> None:
    assert read(defaults, "hostname=robot1\nnetwork=wlan0 dhcp\n") == (["hostname=robot1"], [
        "ddx.txt, line 2: network=wlan0 dhcp: which network? wifi=NAME PASSPHRASE is needed, too"])
    assert read(defaults, "network=eth0 dhcp\nwifi=hall secret12\n") == (["network=eth0 dhcp"], [
        "ddx.txt, line 2: wifi=...: network=wlan0 dhcp is needed, too"])
    taken, wrong = read(defaults, "network=wlan0 dhcp\nwifi=hall short\n")
    assert taken == [] and len(wrong) == 1 and "line 2" in wrong[0]  # one mistake is reported once
    assert len(read(defaults, "wifi=hall secret12\nwifi=hall secret13\nnetwork=wlan0 dhcp\n")[1]) == 1


def test_additions_of_editors_are_accepted(defaults: pathlib.Path) -> None:
    text = b"\xef\xbb\xbfhostname = robot1\r\n\r\n  # mine\r\n\tnetwork=eth0\t dhcp  \r\nconsole=open"
    assert read(defaults, text) == (["hostname=robot1", "network=eth0 dhcp", "console=open"], [])


def test_a_repeated_line_is_reported(defaults: pathlib.Path) -> None:
    taken, wrong = read(defaults, "network=eth0 dhcp\nnetwork=eth1 dhcp\nnetwork=eth0 10.0.0.1/8\n")
    assert taken == ["network=eth0 dhcp", "network=eth1 dhcp"]
    assert wrong == ["ddx.txt, line 3: network=eth0 10.0.0.1/8: line 1 has set this already"]


def test_the_image_s_example_file_is_valid(defaults: pathlib.Path) -> None:
    """Each example line is valid without its # and its explanation."""
    lines = [line.removeprefix("# ") for line in (TOP / "board/common/ddx.txt").read_text().splitlines()]
    examples = [line.split("  ")[0] for line in lines if "=" in line.split(" ")[0]]
    taken, wrong = read(defaults, "\n".join(examples))
    keys = {"hostname", "console", "country", "network", "dns", "ntp", "panel", "service", "ssh_key", "wifi"}
    assert wrong == [] and {line.split("=")[0] for line in taken} == keys
