# SPDX-License-Identifier: GPL-2.0-or-later
"""Guests for the boot tests: the image of BOARD (default: the development image), as flashed, with each firmware."""
import contextlib
import os
import pathlib
from collections.abc import Iterator
from typing import Any

import pytest

import build
from lib import evidence, firewire
from parts.common import OUTPUT, run
from parts.disk import disk
from parts.guest import machine, qemu, session, testdisk
from parts.guest.laptop import free_port
from parts.guest.machine import Machine
from parts.image import native
from parts.media import clip as default_clip
from parts.testing import suite

from . import camera, iidc, networked
from .networked import Robot, Streamed
from .noise import Noise, noisy

BOARD = os.environ.get("BOARD") or machine.DEV
MACHINES = machine.machines(BOARD)
# The development image's kernel and loader are not the product's: with its second firmware, run only these. With the
# first one, the gate boots past a damaged slot in test_rescue.py, so that these are `long`.
OFTEN = ("test_slots.py", "test_updatecut.py")
WORK = OUTPUT / "test" / BOARD / os.environ.get("PYTEST_XDIST_WORKER", "")
# Tests that share one of these guests run in one process; other tests are grouped by file.
SHARED = {"guest": "clip", "recorded": "clip", "closed": "clip", "camera_guest": "camera", "bus_guest": "bus",
          "recorder": "recorder", "robot": "network", "streamed": "network"}
# Groups that take longest. They come first, so that no process waits for the other one's long group at the end.
LONGEST = ("clip", "bus", "camera", "recorder", "network", "test_flash.py")
CARD = 32 << 30    # bytes; the disk of `recorder`
STICK_MB = 64
SLOW = 3_000_000   # bytes a second: slow enough to pull the stick out in time
# Evidence of the guests that stopped during this test, which may fail only after that.
GONE: list[evidence.Evidence] = []
NOISE: dict[qemu.Guest, Noise] = {}


def witness(guest: qemu.Guest, failed: bool) -> None:
    GONE.append(evidence.take(guest, failed))


qemu.Guest.witness = witness


def pytest_runtest_logstart() -> None:
    GONE.clear()


# Outermost, so that it runs last: the failure's text decides about a second run, and guests' messages are not in it.
@pytest.hookimpl(hookwrapper=True, tryfirst=True)  # type: ignore[misc]
def pytest_runtest_makereport(item: pytest.Item):  # type: ignore[no-untyped-def]
    """Keep the guests' messages of a failed test."""
    report = (yield).get_result()
    if report.failed:
        found = [*GONE, *(evidence.take(guest, True) for guest in qemu.Guest.alive)]
        report.sections += evidence.keep(found, suite.FAILED / suite.slug(suite.plain(item.nodeid)))


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    second = [f"[{one.firmware}" for one in MACHINES[1:]]
    dropped = [item for item in items if BOARD == machine.DEV and item.path.name not in OFTEN
               and any(name in item.name for name in second)]
    if BOARD == machine.DEV and second:
        for item in items:
            if item.path.name in OFTEN and f"[{MACHINES[0].firmware}" in item.name:
                item.add_marker(pytest.mark.long)
    config.hook.pytest_deselected(items=dropped)
    items[:] = sorted((item for item in items if item not in dropped), key=turn)


def turn(item: pytest.Item) -> int:
    """pytest-xdist hands out groups in this order."""
    if item.path.parent != pathlib.Path(__file__).parent:
        return -1
    group = together(item).split()[0]
    return LONGEST.index(group) if group in LONGEST else len(LONGEST)


# pytest_collection_modifyitems would be too late: xdist has read the groups by then.
def pytest_itemcollected(item: pytest.Item) -> None:
    item.add_marker(pytest.mark.xdist_group(together(item)))


def together(item: pytest.Item) -> str:
    """The group of a test; one process runs all tests of a group."""
    assert isinstance(item, pytest.Function)
    found = item._fixtureinfo.name2fixturedefs
    shared = {group for name, group in SHARED.items() if name in found and found[name][-1].func.__module__ == __name__}
    parts = getattr(item, "callspec", None)
    firmware = parts.params["board"].firmware if parts and "board" in parts.params else ""
    return f"{min(shared, default=item.path.name)} {firmware}"


@pytest.fixture(scope="session")
def work() -> pathlib.Path:
    WORK.mkdir(parents=True, exist_ok=True)
    return WORK


@pytest.fixture(scope="session")
def image() -> Iterator[pathlib.Path]:
    """The file that is flashed; no test may change it."""
    path = build.dev([native.build()]) if BOARD == machine.DEV else machine.image(BOARD)
    before = disk.digest(path)
    yield path
    assert disk.digest(path) == before, "the image was changed by the tests"


@pytest.fixture(scope="session")
def root(image: pathlib.Path) -> pathlib.Path:
    """The image's root file system, unpacked."""
    return image.parent / "root"


@pytest.fixture(scope="session")
def accel() -> str:
    return qemu.acceleration(build.dev([native.build()]))


@pytest.fixture(scope="session", params=MACHINES, ids=[one.firmware for one in MACHINES])
def board(request: pytest.FixtureRequest) -> Machine:
    """The machine to boot in, once with each firmware that the board supports."""
    found = request.param
    assert isinstance(found, Machine)
    return found


@pytest.fixture(scope="session")
def boot(image: pathlib.Path, accel: str, board: Machine, work: pathlib.Path) -> qemu.Boot:
    """Start a guest: boot("name of its log", ...) with further arguments of Guest(); `accel` replaces the default."""
    def start(name: str, **options: Any) -> qemu.Guest:
        log = work / f"{name}.{board.firmware}.log"
        return qemu.Guest(image, options.pop("accel", accel), board, log=log, **options)
    return start


@contextlib.contextmanager
def kept(guest: qemu.Guest) -> Iterator[None]:
    """Keep a guest for later tests, paused while others run, since the host has two processors."""
    qemu.Guest.kept.append(guest)
    yield
    qemu.Guest.kept.remove(guest)


@pytest.fixture(scope="session")
def clip() -> pathlib.Path:
    """20 s of numbered frames."""
    path = OUTPUT / "clip.y4m"
    if not path.exists():
        # Renamed when complete, so that neither an interrupted nor a parallel run leaves or reads a partial clip.
        default_clip.write(path.with_suffix(f".{os.getpid()}")).rename(path)
    return path


@pytest.fixture(scope="session")
def short_clip(work: pathlib.Path) -> pathlib.Path:
    """The first half of `clip`."""
    return default_clip.write(work / "short-clip.y4m", default_clip.SHORT)


@pytest.fixture(scope="session")
def guest(boot: qemu.Boot, work: pathlib.Path, short_clip: pathlib.Path) -> Iterator[qemu.Guest]:
    """A guest that records the short clip, with a shell."""
    with boot("guest", test_disk=testdisk.make(work / "clip.img", short_clip)) as running:
        running.shell()
        with kept(running):
            yield running


@pytest.fixture(scope="session")
def camera_guest(boot: qemu.Boot, work: pathlib.Path, board: Machine) -> Iterator[qemu.Guest]:
    """A guest with vivid and a second of the clip for its output; no recorder runs."""
    feed = default_clip.write(work / "feed.y4m", 1)
    with boot("camera", test_disk=camera.disk(work, board.board, feed), more_memory=256) as running:
        camera.prepare(running)
        running.sh("/etc/init.d/S*ddxvideosave stop")
        camera.vivid(running)
        with kept(running):
            yield running


@pytest.fixture(scope="session")
def bus_guest(boot: qemu.Boot, work: pathlib.Path, board: Machine) -> Iterator[qemu.Guest]:
    """A guest for cameras on buses that a program or a module simulates; no grabber and no recorder runs."""
    second, jpeg = default_clip.write(work / "second.y4m", 1), work / "second.mjpeg"
    run(["ffmpeg", "-v", "error", "-y", "-i", second, "-q:v", "3", "-pix_fmt", "yuvj422p", "-f", "mjpeg", jpeg])
    # The store's usual memory is too small for the pictures of five FireWire cameras.
    more: dict[str, pathlib.Path | str] = {"feed.mjpeg": jpeg, "ddxstore.conf": "m=64M\n"}
    if board.board == machine.DEV:  # the module is built for the development image's kernel alone
        more.update(firewire.files(work))
    with iidc.booted(boot, work, board, "bus", more) as running:
        with kept(running):
            yield running


@pytest.fixture(scope="session")
def stick(work: pathlib.Path) -> pathlib.Path:
    path = work / "stick.img"
    path.unlink(missing_ok=True)
    run(["mkfs.vfat", "-C", path, str(STICK_MB << 10)])
    return path


@pytest.fixture(scope="session")
def recorder(boot: qemu.Boot, work: pathlib.Path, clip: pathlib.Path, stick: pathlib.Path) -> Iterator[qemu.Guest]:
    """A machine with a disk larger than the image, which records continuously into files of 8 MB, with a slow stick
    plugged in."""
    disk = testdisk.make(work / "stick-test.img", clip, {"ddxvideoload.conf": "loop=\nreaders=1\n",
                                                         "ddxvideosave.conf": "segment=8\n"})
    extra = ("-device", "qemu-xhci,id=usb",
             "-drive", f"if=none,id=stick,file={stick},format=raw,cache=unsafe,throttling.bps-write={SLOW}",
             "-device", "usb-storage,bus=usb.0,drive=stick,id=stick,removable=on")
    with boot("recorder", size=CARD, test_disk=disk, extra=extra, more_memory=64) as running:
        running.shell()
        with kept(running):
            yield running


@pytest.fixture(scope="session")
def closed(boot: qemu.Boot, board: Machine) -> Iterator[qemu.Guest]:
    """A guest as flashed: nothing provisioned, no test disk. Its boot before did not come up, and a device sends on its
    serial line from power-on."""
    with boot("closed", console=False, environment=("begun=1",), processors=1) as running, \
            noisy(running, board.firmware) as talk:
        NOISE[running] = talk
        with kept(running):
            yield running


@pytest.fixture
def noise(closed: qemu.Guest) -> Noise:
    """The sender on the closed guest's serial line."""
    return NOISE[closed]


@pytest.fixture(scope="session")
def recorded(guest: qemu.Guest, short_clip: pathlib.Path, work: pathlib.Path) -> session.Result:
    """The result of recording the whole short clip and comparing the recording with it."""
    session.wait_for_clip(guest, default_clip.SHORT * default_clip.RATE)
    session.stop_recorder(guest)
    result = session.collect(guest, short_clip, work / "recorded.y4m")
    guest.sh("mount -o remount,rw /rec && /etc/init.d/S*ddxvideosave start")
    return result


@pytest.fixture(scope="session")
def robot(boot: qemu.Boot, work: pathlib.Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    """A guest in a network. Its recorder is off, and its loader waits for three readers of the clip."""
    folder, port = tmp_path_factory.mktemp("robot"), free_port()
    networked.make_keys(folder)
    clip = default_clip.write(work / "stream.y4m", networked.CLIP_SECONDS)
    provision = f"{networked.PROVISION}ssh_key={(folder / f'{networked.KEYS[0]}.pub').read_text()}"
    with boot("robot", provision=provision, test_disk=testdisk.make(work / "stream.img", clip, networked.SETTINGS),
              keep=folder, extra=networked.cards(port)) as running:
        running.shell()
        with kept(running):
            yield Robot(running, port, folder)


@pytest.fixture(scope="session")
def streamed(robot: Robot, work: pathlib.Path) -> Streamed:
    """The clip, recorded by that guest and shown from the network."""
    return networked.stream(robot.guest, work / "stream.y4m", work / "stream-recorded.y4m")
