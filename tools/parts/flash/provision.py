# SPDX-License-Identifier: GPL-2.0-or-later
"""Settings of one machine: lines of ddx.txt on the boot partition, see board/common/ddx.txt."""
import base64
import binascii
import dataclasses
import os
import pathlib
import subprocess

from parts.common import TOP, Failed, run, scratch
from parts.disk import mbr

FILE = "::ddx.txt"
DEAF, HEARD = "::serial-off.txt", "::serial-on.txt"  # see board/common/serial-off.txt
PARSER = TOP / "overlay/usr/libexec/ddx/provision.awk"  # the one in the image
ENOUGH = 65536  # the machine reads only this many bytes of the file


def _check(word: str, value: str, line: str) -> str:
    """The line, if the machine accepts it unchanged."""
    done = subprocess.run(["awk", "-f", PARSER], input=line, capture_output=True, text=True, check=True,
                          env={**os.environ, "LC_ALL": "C"})
    if "\n" in line or done.stdout != line + "\n":
        said = done.stderr.strip()
        begin = f"ddx.txt, line 1: {line[:60]}: "
        reason = said.removeprefix(begin) if said.startswith(begin) else said.rpartition(": ")[2]
        raise Failed(f"{word}={value}: {reason or 'a single line is needed'}")
    return line


def _key(line: str) -> bool:
    """Whether a public key's type is repeated in its body: an incomplete or wrong key would allow no login."""
    kind, _, rest = line.partition(" ")
    try:
        body = base64.b64decode(rest.partition(" ")[0], validate=True)
    except binascii.Error:
        return False
    return body[:4] == len(kind).to_bytes(4, "big") and body[4:].startswith(kind.encode())


def lines(ssh_key: str, host_name: str, console: str, network: str = "") -> list[str]:
    """The lines for the file; empty words are left out."""
    found = []
    if host_name:
        found.append(_check("HOSTNAME", host_name, f"hostname={host_name}"))
    if console:
        found.append(_check("CONSOLE", console, f"console={console}"))
    if network:
        found.append(_check("NETWORK", network, f"network={network}"))
    if ssh_key:
        try:
            text = pathlib.Path(ssh_key).read_text()
        except (OSError, UnicodeDecodeError) as error:
            raise Failed(f"SSH_KEY={ssh_key}: cannot be read: {getattr(error, 'strerror', 'not a text')}") from None
        if "PRIVATE KEY" in text:
            raise Failed(f"SSH_KEY={ssh_key}: this is a private key; the public one is in the file that ends in .pub")
        keys = [line.strip() for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
        if not keys or not all(map(_key, keys)):
            raise Failed(f"SSH_KEY={ssh_key}: not a file of SSH public keys, one a line")
        found += [_check("SSH_KEY", ssh_key, f"ssh_key={key}") for key in keys]
    return found


def merge(text: str, new: list[str]) -> str:
    """The file's text with the new lines in place of those with the same keys."""
    keys = {line.split("=", 1)[0] for line in new}
    kept = [line for line in text.splitlines() if line.split("=", 1)[0] not in keys]
    return "\n".join([*kept, *new]) + "\n"


def is_heard(serial: str) -> bool:
    """Whether boot menu and shell use the serial line."""
    if serial not in ("", "on"):
        raise Failed(f"SERIAL={serial}: only SERIAL=on is possible")
    return serial == "on"


@dataclasses.dataclass(frozen=True)
class Boot:
    """An image's boot partition: its offset, its content, and the text of its ddx.txt."""
    begin: int
    content: bytes
    text: str

    def is_out_of_reach(self) -> bool:
        """Whether keys may log in over the network, but no interface is on."""
        keys = {line.split("=", 1)[0].strip() for line in self.text.splitlines()}
        return "ssh_key" in keys and "network" not in keys


def boot_partition(image: pathlib.Path, new: list[str], heard: bool) -> Boot:
    """The image's boot partition with the new lines in ddx.txt."""
    boot = mbr.partition(image, 1)
    with scratch() as folder:
        copy, file = pathlib.Path(folder, "boot"), pathlib.Path(folder, "ddx.txt")
        with image.open("rb") as source, copy.open("wb") as target:
            source.seek(boot.begin)
            target.write(source.read(boot.end - boot.begin))
        run(["mcopy", "-n", "-i", copy, FILE, file])
        text = merge(file.read_text(errors="replace"), new)
        if len(text.encode()) > ENOUGH:
            raise Failed(f"ddx.txt would be larger than {ENOUGH} bytes")
        file.write_text(text)
        run(["mcopy", "-o", "-i", copy, file, FILE])
        if run(["mtype", "-i", copy, FILE]) != text:
            raise Failed("ddx.txt on the boot partition is not what was written")
        if heard:
            run(["mren", "-i", copy, DEAF, HEARD])
        return Boot(boot.begin, copy.read_bytes(), text)
