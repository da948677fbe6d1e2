# SPDX-License-Identifier: GPL-2.0-or-later
"""A laptop beside a guest: its own home and shell, for which the guest's SSH is `root@robot1`.

Its home is mounted over root's in a mount namespace, because ssh finds the home in /etc/passwd, not in $HOME.
"""
import os
import pathlib
import re
import shutil
import socket
import subprocess

from parts.common import MORTAL, Failed

SHELLS = ("sh", "zsh-static")  # of Linux and of macOS
# ssh and ssh-keygen ask on a terminal only, and drop input from before the question.
SETUP = """\
mount --bind "$1" /root && cd /root && export HOME=/root SHELL=/bin/sh LAPTOP_SHELL="$2" LAPTOP_COMMAND="$3" &&
exec script -qec 'exec "$LAPTOP_SHELL" -c "$LAPTOP_COMMAND"' /dev/null
"""
ASKED = re.compile(r"(: |\? )$")


def free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


def is_free(port: int) -> bool:
    """Whether a program could listen there."""
    with socket.socket() as one:
        one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            one.bind(("127.0.0.1", port))
        except OSError:
            return False
        return True


def forward(port: int, https: int = 0, card: str = "virtio-net-pci") -> tuple[str, ...]:
    """QEMU's options for a network card, with the guest's SSH at this port, and the panel at the other one."""
    panel = f",hostfwd=tcp:127.0.0.1:{https}-:443" if https else ""
    return ("-netdev", f"user,id=laptop,hostfwd=tcp:127.0.0.1:{port}-:22{panel}",
            "-device", f"{card},netdev=laptop")


class Laptop:
    def __init__(self, folder: pathlib.Path, shell: str, port: int) -> None:
        self.home, self.shell, self.port = folder / shell, shell, port
        shutil.rmtree(self.home, ignore_errors=True)
        ssh = self.home / ".ssh"
        ssh.mkdir(parents=True, mode=0o700)
        (ssh / "config").write_text(f"Host robot1\n    HostName 127.0.0.1\n    Port {port}\n")

    def type(self, command: str) -> tuple[int, str]:
        """Exit status and output. Questions with the choice `yes` get that answer, others only Enter."""
        user = [] if os.geteuid() == 0 else ["--map-root-user"]
        words = [*MORTAL, "unshare", "--mount", *user, "sh", "-c", SETUP, "sh", str(self.home), self.shell, command]
        process = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        assert process.stdin and process.stdout
        shown = ""
        while data := os.read(process.stdout.fileno(), 65536):
            shown += data.decode(errors="replace")
            if ASKED.search(shown):
                process.stdin.write(b"yes\n" if "(yes/no" in shown.splitlines()[-1] else b"\n")
                process.stdin.flush()
        process.stdin.close()
        process.stdout.close()
        return process.wait(), shown

    def sh(self, command: str) -> str:
        """The output of a command that must succeed."""
        status, shown = self.type(command)
        if status:
            raise Failed(f"exit status {status}: {self.shell}: {command}: {shown}")
        return shown

    def key(self) -> str:
        """The public key, one line, after `ssh-keygen`."""
        return (self.home / ".ssh/id_ed25519.pub").read_text().strip()
