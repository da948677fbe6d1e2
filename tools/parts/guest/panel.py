# SPDX-License-Identifier: GPL-2.0-or-later
"""A machine with the panel, its visitors with a browser, and those that send what no browser would send."""
from __future__ import annotations

import base64
import contextlib
import hashlib
import http.client
import json
import pathlib
import ssl
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from parts.common import MORTAL, PATIENCE, Closing, Failed, wait_until
from parts.guest.native_machine import NativeMachine
from parts.media import clip
from parts.media.browser import Browser
from parts.media.webkit import WebKit

PASSPHRASE = "open sesame, please"
FRAMES = 50  # of the clip that filming() plays for ever
ADDRESS = "https://127.0.0.1/"
OWN = {"Origin": "https://127.0.0.1", "X-Panel": "1"}  # headers of the page's own requests
SHOWN = 100.0  # s; until then a page shows what it shall, also on a busy machine
# The public key in a P-256 certificate: what comes before its 64 bytes, and the length with them.
KEY_BEGIN, KEY_SIZE = bytes.fromhex("3059301306072a8648ce3d020106082a8648ce3d030107034200"), 91
# Sends each request of standard input (a line of JSON: method, path, headers, body), and prints status and headers.
CLIENT = """
import http.client, json, ssl, sys
context = ssl._create_unverified_context()
for line in sys.stdin:
    method, path, headers, body = json.loads(line)
    link = http.client.HTTPSConnection("127.0.0.1", context=context, timeout=float(sys.argv[1]))
    link.putrequest(method, path, skip_host="Host" in headers)
    for name, value in headers.items():
        link.putheader(name, value)
    link.putheader("Content-Length", str(len(body)))
    link.endheaders(body.encode())
    answer = link.getresponse()
    print(json.dumps([answer.status, dict(answer.headers), answer.read().decode(errors="replace")]))
    link.close()
"""


Request = tuple[str, str, dict[str, str], str]  # method, path, headers, body


def start(robot: NativeMachine, passphrase: str = PASSPHRASE) -> None:
    """As with a line panel= in ddx.txt, which the machine in namespaces has not."""
    if passphrase:
        robot.sh(f"echo 'panel={passphrase}' >> /run/provision")
    robot.sh("ddxctl enable ddxpanel")
    robot.wait_until("ddxctl logs ddxpanel | grep -q ready")


@contextlib.contextmanager
def filming(root: pathlib.Path, keep: pathlib.Path, movie: pathlib.Path | None = None,
            settings: Mapping[str, str] | None = None) -> Iterator[NativeMachine]:
    """A machine with the panel, whose loader plays a clip for ever, and which records. `movie`: instead of one with
    numbered frames; it is moved there. `settings`: of other services, by name."""
    (keep / "test").mkdir(parents=True)
    (keep / "data/ddx").mkdir(parents=True, exist_ok=True)
    if movie:
        movie.rename(keep / "test/clip.y4m")
    else:
        clip.write(keep / "test/clip.y4m", FRAMES // clip.RATE)
    for name, text in {"ddxvideoload": "loop=\n", **(settings or {})}.items():
        (keep / f"data/ddx/{name}.conf").write_text(text)
    with NativeMachine(root, keep) as machine:
        start(machine)
        yield machine


def inside(robot: NativeMachine) -> list[str]:
    """Words before a command of the host, for the machine's network."""
    return ["nsenter", f"--net=/proc/{robot.init}/ns/net"]


def certificate(robot: NativeMachine) -> bytes:
    """The certificate (DER) that the web server shows."""
    fetch = "import ssl; print(ssl.get_server_certificate(('127.0.0.1', 443)))"
    done = subprocess.run([*MORTAL, *inside(robot), sys.executable, "-c", fetch], capture_output=True, text=True,
                          check=True)
    return ssl.PEM_cert_to_DER_cert(done.stdout.strip())


def digest(der: bytes) -> str:
    """As browsers show it."""
    return hashlib.sha256(der).digest().hex(":").upper()


def ask(robot: NativeMachine, requests: Sequence[Request], seconds: float = 60) -> list[Any]:
    """Status, headers and body of each answer, which comes within these seconds."""
    lines = "".join(json.dumps(one) + "\n" for one in requests)
    done = subprocess.run([*MORTAL, *inside(robot), sys.executable, "-c", CLIENT, str(seconds)], input=lines,
                          capture_output=True, text=True, check=True)
    return [json.loads(line) for line in done.stdout.splitlines()]


def log_in(robot: NativeMachine) -> str:
    """The cookie of a new session."""
    _, headers, _ = ask(robot, [("POST", "/panel/login", OWN, PASSPHRASE)])[0]
    return str(headers["Set-Cookie"]).split(";")[0]


class Phone:
    """A program that asks the panel of a machine `name` behind a port of this host, and takes one certificate only: the
    one with this SHA-256."""

    def __init__(self, port: int, name: str, shown: str) -> None:
        self.port, self.shown = port, shown
        self._headers = {"Host": f"{name}.local", "Origin": f"https://{name}.local", "X-Panel": "1"}

    def ask(self, method: str, path: str, body: str = "") -> tuple[int, str]:
        """Status and body; the cookie of a login goes with all further requests."""
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
        link = http.client.HTTPSConnection("127.0.0.1", self.port, context=context, timeout=PATIENCE)
        try:
            link.connect()
            found = digest(link.sock.getpeercert(True) or b"")
            if found != self.shown:
                raise Failed(f"the panel's certificate is {found}, not {self.shown}")
            link.request(method, path, body or None, self._headers)
            answer = link.getresponse()
            if cookie := answer.getheader("Set-Cookie"):
                self._headers["Cookie"] = cookie.split(";")[0]
            return answer.status, answer.read().decode(errors="replace")
        finally:
            link.close()

    def order(self, *words: str) -> list[str]:
        """The lines of an order's output, without the last one, of the panel: it must have succeeded."""
        status, text = self.ask("POST", "/panel/order", "\n".join(words))
        lines = text.splitlines()
        if status != 200 or json.loads(lines[-1]) != {"end": "exited", "status": 0}:
            raise Failed(f"{words}: {status}: {text}")
        return lines[:-1]


class Visitor(Closing):
    """A browser on a phone; Chromium takes no other certificate than this one. `words`: before the browser's command,
    instead of those for the machine's own network. Without a robot the browser runs in the host's network, where a port
    leads to a guest."""

    def __init__(self, robot: NativeMachine | None, folder: pathlib.Path, shown: bytes, webkit: bool = False,
                 words: Sequence[str] = ()) -> None:
        key = shown[shown.index(KEY_BEGIN):][:KEY_SIZE]
        pin = base64.b64encode(hashlib.sha256(key).digest()).decode()
        place = words or (inside(robot) if robot else ())
        self.browser: Browser | WebKit = WebKit(place, folder) if webkit else Browser(
            place, folder, f"--ignore-certificate-errors-spki-list={pin}")

    def open(self, address: str = ADDRESS) -> None:
        self.address = address
        self.browser.visit(address)

    def sees(self, expression: str) -> None:
        """Wait until an expression is true in the page.

        Chromium shows an error page if it sets up its check of certificates during a visit, as it does once after its
        start; the page is opened again then."""
        def true() -> bool:
            try:
                if self.browser.value(f"!!({expression})"):
                    return True
                if "ERR_CERT_VERIFIER_CHANGED" in self.text():
                    self.open(self.address)
                return False
            except Failed:  # a page that is being loaded has no such element, or nothing at all
                if self.browser.process.poll() is not None:
                    raise
                return False

        try:
            wait_until(true, f"the page does not show: {expression}", 0.1, SHOWN)
        except Failed as error:
            raise Failed(f"{error}; it shows: {self.text()}") from None

    def text(self) -> str:
        return str(self.browser.value("document.body ? document.body.innerText : ''"))

    def reads(self, words: str) -> None:
        self.sees(f"document.body.innerText.includes({json.dumps(words)})")

    def taps(self, expression: str) -> None:
        self.browser.value(f"{expression}.click()")

    def agrees(self, expression: str) -> None:
        """The second tap on a button that has named its consequence; both taps, if the page has taken that back."""
        self.browser.value(f"((one) => {{ if (!one.classList.contains('danger')) one.click(); one.click(); }})"
                           f"({expression})")

    def logs_in(self, passphrase: str) -> None:
        self.browser.value(f"document.getElementById('passphrase').value = {json.dumps(passphrase)}")
        self.taps("document.querySelector('form button')")

    def enters(self, page: str) -> None:
        """From the page that asks for the passphrase to that one."""
        self.sees("document.getElementById('passphrase')")
        self.logs_in(PASSPHRASE)
        link = f"document.querySelector('a[href=\"#{page}\"]')"
        self.sees(link)
        self.taps(link)

    def end(self) -> None:
        self.browser.end()
