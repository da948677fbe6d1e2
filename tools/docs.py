#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""docs.py [BOARD]: types each command of docs/technician.md into the image, as a technician would; takes pictures."""
import json
import pathlib
import re
import sys
import time
from typing import Any

import build
from parts.common import OUTPUT, TOP, Failed, run, say
from parts.guest import machine, qemu, session, testdisk
from parts.guest.qemu import Guest
from parts.image import native
from parts.media import clip

PAGE = TOP / "docs/technician.md"
PROMPT = re.compile(r"^    robot# (.*)$", re.M)
PICTURES = {"start": "", "health": "ddxctl health", "services": "ddxctl services"}
ANSWERS = {"ddxctl reset settings": "settings"}
COMPLAINS = "ddxctl health"  # its status 1 is a complaint about the machine, which may be busy
EXAMPLE = "video-000012"     # a recording that the page speaks of; any that is there will do
STICK_MB = 1024
GROWS = 1 << 30              # bytes that the disk is larger than the image
KEYS = {" ": "spc", "-": "minus", ".": "dot", "=": "equal", "/": "slash", "\n": "ret"}


def type_in(guest: Guest, text: str) -> None:
    """On the keyboard at the machine."""
    for letter in text:
        key = {"type": "qcode", "data": KEYS.get(letter, letter)}
        guest.monitor("send-key", keys=[key], **{"hold-time": 20})
        time.sleep(0.05)


def picture(guest: Guest, name: str) -> None:
    path = TOP / "docs/pictures" / f"{name}.png"
    guest.monitor("screendump", filename=str(path), format="png")
    say(f"docs: {path.relative_to(TOP)}")


def pictures(guest: Guest) -> None:
    """What the screen shows."""
    guest.wait_until("pidof getty sh | grep -q .")
    time.sleep(3)
    for name, command in PICTURES.items():
        if command:
            type_in(guest, f"clear\n{command}\n")
            time.sleep(12)
        picture(guest, name)


def commands() -> list[str]:
    """What the page has typed at the machine."""
    return PROMPT.findall(PAGE.read_text())


def provide(image: pathlib.Path, work: pathlib.Path) -> dict[str, Any]:
    """What the guest needs: a clip to record, a cable, a stick, and room."""
    work.mkdir(parents=True, exist_ok=True)
    stick = work / "stick.img"
    stick.unlink(missing_ok=True)
    run(["mkfs.vfat", "-C", stick, str(STICK_MB << 10)])
    disk = testdisk.make(work / "docs.img", clip.write(work / "docs.y4m", 10),
                         {"ddxvideoload.conf": "loop=\nrate=0.4\n", "ddxvideosave.conf": "segment=8\n"})
    extra = ("-netdev", "user,id=net", "-device", "virtio-net-pci,netdev=net", "-device", "qemu-xhci,id=usb",
             "-drive", f"if=none,id=stick,file={stick},format=raw,cache=unsafe",
             "-device", "usb-storage,bus=usb.0,drive=stick,removable=on")
    return {"test_disk": disk, "extra": extra, "size": image.stat().st_size + GROWS,
            "provision": "hostname=robot1\nnetwork=eth0 dhcp\nservice=ddxvideoV4L off\n"}


def prepare(guest: Guest) -> None:
    """Two recordings, one of which goes on."""
    guest.shell()
    session.wait_for_recording(guest)
    guest.sh("ddxctl record split")
    guest.wait_until("[ $(ddxctl recordings list --json | grep -c 'finished\\|recording') -ge 2 ]")


def there(guest: Guest, command: str) -> str:
    """The command, about a recording that there is."""
    if EXAMPLE not in command:
        return command
    found = [json.loads(line) for line in guest.sh("ddxctl recordings list --json").splitlines()]
    return command.replace(EXAMPLE, str(found[0]["recording"]))


def check(guest: Guest, command: str) -> bool:
    """It has to succeed, without a complaint."""
    if command == "poweroff":
        guest.poweroff()
        return True
    answer = ANSWERS.get(command)
    real = there(guest, command)
    status, text = guest.shell().run(f"echo {answer} | {real}" if answer else real)
    good = status == 0 or (command == COMPLAINS and status == 1)
    say(f"docs: {'fine' if good else 'FAILED'}: {command}")
    if not good:
        say(text)
    return good


def main() -> int:
    board = sys.argv[1] if len(sys.argv) > 1 and sys.argv[1] else machine.DEV
    (TOP / "docs/pictures").mkdir(exist_ok=True)
    try:
        dev = build.dev([native.build()])
        image = dev if board == machine.DEV else machine.image(board)
        with Guest(image, qemu.acceleration(dev), machine.machines(board)[0],
                   **provide(image, OUTPUT / "docs")) as guest:
            prepare(guest)
            pictures(guest)
            good = all([check(guest, command) for command in commands()])
    except Failed as error:
        say(f"docs: {error}")
        return 1
    missing = [name for name in re.findall(r"\]\((pictures/\S+)\)", PAGE.read_text())
               if not pathlib.Path(PAGE.parent, name).exists()]
    for name in missing:
        say(f"docs: {PAGE.name} shows {name}, which is not there")
    say(f"docs: {len(commands())} commands, {'all fine' if good else 'some failed'}")
    return 0 if good and not missing else 1


if __name__ == "__main__":
    sys.exit(main())
