# SPDX-License-Identifier: GPL-2.0-or-later
"""The evidence of a failed test: the guest's console, logs of services and kernel, QEMU's messages, and the commit."""
import contextlib
import dataclasses
import pathlib
import re

from parts.common import TOP, commit
from parts.guest.channel import Channel, Timeout
from parts.guest.qemu import Guest

SECONDS = 20.0  # time for an answer; later, only the console is kept
TAIL = 30       # lines of each text that are printed
COMMAND = ("tail -n +1 /run/log/* /run/log/*/current /run/log/lastboot/* 2> /dev/null; "
           "printf '\\n==> dmesg <==\\n'; dmesg")
HEADER = re.compile(r"^==> (\S+) <==$", re.MULTILINE)


@dataclasses.dataclass
class Evidence:
    """The texts of one guest, by name."""
    guest: str
    texts: dict[str, str]


def _logs(guest: Guest, failed: bool) -> str:
    """The guest's logs; after a failure from a second shell, since the usual one may hang."""
    with contextlib.suppress(Timeout, OSError):
        if not failed:
            return guest.opened["hvc0"].run(COMMAND, SECONDS)[1] if "hvc0" in guest.opened else ""
        with contextlib.closing(Channel(guest.folder / "hvc1")) as channel:
            channel.open_shell(SECONDS)
            try:
                return channel.run(COMMAND, SECONDS)[1]
            finally:
                channel.begin("exit")  # a new shell starts, for a test that opens this console later
    return ""


def take(guest: Guest, failed: bool) -> Evidence:
    """Collect a guest's evidence. `failed`: wait for a shell, also if none was open."""
    texts = {}
    if not guest.paused and guest.process.poll() is None:
        parts = HEADER.split(_logs(guest, failed))
        texts = {name.removeprefix("/run/log/").removesuffix("/current"): text.strip("\n") + "\n"
                 for name, text in zip(parts[1::2], parts[2::2]) if text.strip()}
    texts["console"] = guest.log.read_text(errors="replace") if guest.log.exists() else ""
    texts["qemu"] = guest.words()
    return Evidence(guest.log.stem if guest.log.parent != guest.folder else guest.folder.name, texts)


def keep(found: list[Evidence], folder: pathlib.Path) -> list[tuple[str, str]]:
    """Write all texts into the folder; returns a title and the last lines of each, for printing."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "commit").write_text(commit() + "\n")
    shown = [(f"commit (all in {folder.relative_to(TOP)})", commit())]
    for one in found:
        for name, text in one.texts.items():
            path = folder / one.guest / name.replace("/", ".")
            path.parent.mkdir(exist_ok=True)
            path.write_text(text)
            if text.strip():
                shown.append((f"{one.guest}: {name}", "\n".join(text.splitlines()[-TAIL:])))
    return shown
