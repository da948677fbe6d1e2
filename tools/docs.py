#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""docs.py [BOARD]: types each command of docs/technician.md into the image, as a technician would; takes pictures."""
import pathlib
import re
import sys
import time

import build
import clip
import machine
import native
import qemu
import session
import testdisk
from common import OUTPUT, TOP, Failed, say
from qemu import Guest

PAGE = TOP / "docs/technician.md"
PROMPT = re.compile(r"^    robot# (.*)$", re.M)
PICTURES = {"start": "", "health": "ddxctl health", "services": "ddxctl services"}
ANSWERS = {"ddxctl reset settings": "settings"}
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


def check(guest: Guest, command: str) -> bool:
    """It has to succeed, without a complaint."""
    if command == "poweroff":
        guest.poweroff()
        return True
    answer = ANSWERS.get(command)
    status, text = guest.shell().run(f"echo {answer} | {command}" if answer else command)
    say(f"docs: {'fine' if status == 0 else 'FAILED'}: {command}")
    if status:
        say(text)
    return status == 0


def main() -> int:
    commands = PROMPT.findall(PAGE.read_text())
    board = sys.argv[1] if len(sys.argv) > 1 and sys.argv[1] else machine.DEV
    work = OUTPUT / "docs"
    work.mkdir(parents=True, exist_ok=True)
    (TOP / "docs/pictures").mkdir(exist_ok=True)
    try:
        dev = build.dev([native.build()])
        image = dev if board == machine.DEV else machine.image(board)
        disk = testdisk.make(work / "test.img", clip.write(work / "clip.y4m", 10), {"ddxvideoload.conf": "loop=\n"})
        card = ("-netdev", "user,id=net", "-device", "virtio-net-pci,netdev=net")
        with Guest(image, qemu.acceleration(dev), machine.machines(board)[0], test_disk=disk, extra=card,
                   provision="hostname=robot1\nnetwork=eth0 dhcp\nservice=ddxvideoV4L off\n") as guest:
            guest.shell()
            session.wait_for_recording(guest)
            pictures(guest)
            good = all([check(guest, command) for command in commands])
    except Failed as error:
        say(f"docs: {error}")
        return 1
    missing = [name for name in re.findall(r"\]\((pictures/\S+)\)", PAGE.read_text())
               if not pathlib.Path(PAGE.parent, name).exists()]
    for name in missing:
        say(f"docs: {PAGE.name} shows {name}, which is not there")
    say(f"docs: {len(commands)} commands, {'all fine' if good else 'some failed'}")
    return 0 if good and not missing else 1


if __name__ == "__main__":
    sys.exit(main())
