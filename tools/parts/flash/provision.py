# SPDX-License-Identifier: GPL-2.0-or-later
"""What a single machine is told: lines of ddx.txt on the boot partition, see board/common/ddx.txt."""
import base64
import binascii
import pathlib
import re
import tempfile

from parts.common import Failed, run
from parts.disk import mbr

FILE = "::ddx.txt"
DEAF, HEARD = "::serial-off.txt", "::serial-on.txt"  # board/common/serial-off.txt tells more
HOST_NAME = re.compile(r"[a-z0-9]([a-z0-9-]{0,61}[a-z0-9])?")  # as in overlay/etc/init.d/S14provision
KEY = re.compile(r"(ssh-ed25519|ssh-rsa|ecdsa-sha2-nistp(256|384|521)|sk-[a-z0-9-]+@openssh\.com) (\S+)( .*)?")
ENOUGH = 65536  # the machine reads no more of the file


def _key(line: str) -> bool:
    """An SSH public key as in an authorized_keys file, without options: its body names its type once more."""
    match = KEY.fullmatch(line)
    try:
        body = base64.b64decode(match[3], validate=True) if match else b""
    except binascii.Error:
        return False
    return match is not None and body[4:].startswith(match[1].encode()) and body[:4] == len(match[1]).to_bytes(4, "big")


def lines(ssh_key: str, host_name: str, console: str) -> list[str]:
    """The lines for the file; an empty word is not mentioned."""
    found = []
    if host_name:
        if not HOST_NAME.fullmatch(host_name):
            raise Failed(f"HOSTNAME={host_name}: small letters, digits and inner hyphens, 63 at most")
        found.append(f"hostname={host_name}")
    if console:
        if console != "open":
            raise Failed(f"CONSOLE={console}: the only thing to say is CONSOLE=open")
        found.append("console=open")
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
        found += [f"ssh_key={key}" for key in keys]
    return found


def merge(text: str, new: list[str]) -> str:
    """The file with the new lines, instead of what it had under the same keys."""
    keys = {line.split("=", 1)[0] for line in new}
    kept = [line for line in text.splitlines() if line.split("=", 1)[0] not in keys]
    return "\n".join([*kept, *new]) + "\n"


def is_heard(serial: str) -> bool:
    """Whether boot menu and shell listen on the serial line."""
    if serial not in ("", "on"):
        raise Failed(f"SERIAL={serial}: the only thing to say is SERIAL=on")
    return serial == "on"


def boot_partition(image: pathlib.Path, new: list[str], heard: bool) -> tuple[int, bytes]:
    """Where the image's boot partition begins, and what it holds with the new lines in its ddx.txt."""
    boot = mbr.partition(image, 1)
    with tempfile.TemporaryDirectory(prefix="ddx-") as folder:
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
        return boot.begin, copy.read_bytes()
