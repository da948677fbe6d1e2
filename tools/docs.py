#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""docs.py [BOARD]: type each command of docs/technician.md, and take the page's pictures.

Commands after `robot#` are typed into the image, those after `laptop>` into two shells of this machine.
"""
import json
import pathlib
import re
import sys
import time
from typing import Any

import build
from parts.common import OUTPUT, TOP, finish, run, say, scratch
from parts.guest import laptop, machine, panel, qemu, session, testdisk
from parts.guest.laptop import Laptop
from parts.guest.qemu import Guest
from parts.image import wheels

PAGE = TOP / "docs/technician.md"
ROBOT, LAPTOP = "robot#", "laptop>"
PROMPT = re.compile(rf"^    ({ROBOT}|{LAPTOP}) (.*)$", re.M)
KEY = "ed25519"  # in a command that makes or shows the laptop's key, before there is a robot
PICTURES = {"start": "", "health": "ddxctl health", "services": "ddxctl services"}
CONSOLE = "crop=min(iw\\,800):min(ih\\,416):0:0"  # the area with text, on a screen of any size
FILM = "scale=640:-1,split[a][b];[a]palettegen=max_colors=80[p];[b][p]paletteuse=dither=none"  # a small file
PLAY = "ddxvideoplay"
PHONE = (360, 640)  # pixels; the least that the panel is made for
ANSWERS = {"ddxctl reset settings": "settings"}
COMPLAINS = "ddxctl health"  # may exit with 1, because the machine is busy
EXAMPLE = re.compile(r"(video-000012)(-\d+T\d+Z\.y4m)?")  # on the page; any present recording takes its place
STICK_MB = 1024
GROWS = 1 << 30              # bytes that the disk is larger than the image
KEYS = {" ": "spc", "-": "minus", ".": "dot", "=": "equal", "/": "slash", "\n": "ret"}


def type_in(guest: Guest, text: str) -> None:
    """Type text on the guest's keyboard."""
    for letter in text:
        key = {"type": "qcode", "data": KEYS.get(letter, letter)}
        guest.monitor("send-key", keys=[key], **{"hold-time": 20})
        time.sleep(0.05)


def picture(guest: Guest, name: str, filters: str) -> None:
    """Save a picture of the screen, changed by these FFmpeg filters."""
    path, screen = TOP / "docs/pictures" / f"{name}.png", OUTPUT / "docs/screen.png"
    guest.monitor("screendump", filename=str(screen), format="png")
    run(["ffmpeg", "-v", "error", "-y", "-i", screen, "-vf", filters, "-pred", "mixed", path])
    say(f"docs: {path.relative_to(TOP)}")


def pictures(guest: Guest) -> None:
    """Take the pictures of the console and of the player."""
    guest.wait_until("pidof getty sh | grep -q .")
    time.sleep(3)
    for name, command in PICTURES.items():
        if command:
            type_in(guest, f"clear\n{command}\n")
            time.sleep(12)
        picture(guest, name, CONSOLE)
    guest.sh(f"ddxctl enable {PLAY}")
    guest.wait_until(f"ddxctl stats --json | grep -q '{PLAY}'")
    time.sleep(3)
    picture(guest, "screen", FILM)
    guest.sh(f"ddxctl disable {PLAY}")


def panel_pictures(root: pathlib.Path) -> None:
    """Take the pictures of docs/panel.md, in Chromium, of a machine in namespaces."""
    with scratch() as work, panel.filming(root, work / "machine") as robot:
        robot.sh("hostname robot1; ddxctl restart ddxpanel")
        robot.wait_until("ddxctl recordings | grep -q ' recording$'")
        robot.sh("ddxctl record split; ddxctl add ddxvideosend.laptop group=none to=127.0.0.1 port=8004")
        with panel.Visitor(robot, work / "browser", panel.certificate(robot)) as visitor:
            visitor.open()
            visitor.sees("document.getElementById('passphrase')")
            visitor.browser.screen(*PHONE)
            for name, ready in (("login", "Passphrase"), ("health", "checked now"), ("services", "ddxhealth"),
                                ("picture", "a second"), ("recordings", "Copy to stick"),
                                ("streams", "File for players"), ("messages", "logged in"),
                                ("report", "Make the report"), ("machine", "Power off")):
                if name != "login":
                    visitor.open(f"{panel.ADDRESS}#{name}{'/ddxpanel' if name == 'messages' else ''}")
                visitor.reads(ready)
                visitor.browser.picture(TOP / f"docs/pictures/panel-{name}.png")
                if name == "login":
                    visitor.logs_in(panel.PASSPHRASE)
                    visitor.reads("Log out")
    say("docs: docs/pictures/panel-*.png")


def commands() -> list[tuple[str, str]]:
    """The page's commands: ROBOT or LAPTOP, and the command."""
    return PROMPT.findall(PAGE.read_text())


def laptops(work: pathlib.Path) -> list[Laptop]:
    """One laptop for each shell; each has made a key, as the page says."""
    port = laptop.free_port()
    found = [Laptop(work / "laptops", shell, port) for shell in laptop.SHELLS]
    for one in found:
        for _, command in commands():
            if KEY in command:
                one.sh(command)
    return found


def camera(path: pathlib.Path) -> pathlib.Path:
    """A clip of ten seconds of a photograph: Middlebury's "Motorcycle" (CC0), from scikit-image's examples."""
    folder = wheels.folder(wheels.SKIMAGE, wheels.PYTHON_37, "skimage/data/motorcycle") / "skimage/data"
    run(["ffmpeg", "-v", "error", "-y", "-loop", "1", "-framerate", "25", "-i", folder / "motorcycle_left.png",
         "-vf", "scale=384:256", "-frames:v", "250", "-pix_fmt", "yuv420p", path])
    return path


def provide(image: pathlib.Path, work: pathlib.Path, users: list[Laptop]) -> dict[str, Any]:
    """The guest's options: a clip to record, a network, a USB stick, a larger disk, and the laptops' keys."""
    work.mkdir(parents=True, exist_ok=True)
    stick = work / "stick.img"
    stick.unlink(missing_ok=True)
    run(["mkfs.vfat", "-C", stick, str(STICK_MB << 10)])
    disk = testdisk.make(work / "docs.img", camera(work / "docs.y4m"),
                         {"ddxvideoload.conf": "loop=\nrate=0.4\n", "ddxvideosave.conf": "segment=8\n"})
    extra = (*laptop.forward(users[0].port), "-device", "qemu-xhci,id=usb",
             "-drive", f"if=none,id=stick,file={stick},format=raw,cache=unsafe",
             "-device", "usb-storage,bus=usb.0,drive=stick,removable=on")
    keys = "".join(f"ssh_key={one.key()}\n" for one in users)
    return {"test_disk": disk, "extra": extra, "size": image.stat().st_size + GROWS,
            "provision": f"hostname=robot1\nnetwork=eth0 dhcp\nservice=ddxvideoV4L off\n{keys}"}


def prepare(guest: Guest) -> None:
    """Make a finished recording and start another one."""
    guest.shell()
    session.wait_for_recording(guest)
    guest.sh("ddxctl record split")
    guest.wait_until("[ $(ddxctl recordings list --json | grep -c 'finished\\|recording') -ge 2 ]")


def there(guest: Guest, command: str) -> str:
    """The command, with the name of a present recording."""
    if not EXAMPLE.search(command):
        return command
    found = json.loads(guest.sh("ddxctl recordings list --json").splitlines()[0])
    return EXAMPLE.sub(lambda match: str(found["files"][0] if match[2] else found["recording"]), command)


def typed(guest: Guest, users: list[Laptop], machine: str, command: str) -> list[tuple[int, str]]:
    """Exit status and output of the command, on the robot or on each of the laptops."""
    if machine == LAPTOP:
        return [one.type(command) for one in users]
    answer = ANSWERS.get(command)
    return [guest.shell().run(f"echo {answer} | {command}" if answer else command)]


def check(guest: Guest, users: list[Laptop], machine: str, command: str) -> bool:
    """Run a command of the page; whether it succeeded."""
    if command == "poweroff":
        guest.poweroff()
        return True
    if KEY in command:
        return True  # laptops() typed it
    wrong = [text for status, text in typed(guest, users, machine, there(guest, command))
             if status != 0 and not (COMPLAINS in command and status == 1)]
    say(f"docs: {'FAILED' if wrong else 'fine'}: {machine} {command}")
    for text in wrong:
        say(text)
    return not wrong


def main() -> int:
    board = sys.argv[1] if len(sys.argv) > 1 and sys.argv[1] else machine.DEV
    (TOP / "docs/pictures").mkdir(exist_ok=True)
    image, development = build.images(board)
    panel_pictures(development.parent / "root")
    users = laptops(OUTPUT / "docs")
    with Guest(image, qemu.acceleration(development), machine.machines(board)[0],
               **provide(image, OUTPUT / "docs", users)) as guest:
        prepare(guest)
        pictures(guest)
        good = all([check(guest, users, *line) for line in commands()])
    missing = [name for name in re.findall(r"\]\((pictures/\S+)\)", PAGE.read_text())
               if not pathlib.Path(PAGE.parent, name).exists()]
    for name in missing:
        say(f"docs: {PAGE.name} shows {name}, which is not there")
    say(f"docs: {len(commands())} commands, {'all fine' if good else 'some failed'}")
    return 0 if good and not missing else 1


if __name__ == "__main__":
    finish("docs", main)
