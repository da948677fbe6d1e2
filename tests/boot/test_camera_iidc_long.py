# SPDX-License-Identifier: GPL-2.0-or-later
"""IIDC cameras on USB: every mode, parts of the picture, two cameras at once, many replugs."""
import pathlib
from collections.abc import Callable, Iterator

import pytest

from parts.common import PATIENCE
from parts.guest import guest_camera, machine, qemu
from parts.guest.machine import Machine
from parts.guest.qemu import Guest
from parts.media import counters

from . import camera, iidc
from .iidc import FRAMES, Camera, Grabber, expected, wrong

pytestmark = [pytest.mark.retry, pytest.mark.long]
SECONDS = 600  # --seconds that the full number of replugs is for
FRAMES_COME = "'back after\\|Test Cam'"
MODES = ["160x120_YUV444", "320x240_YUV422", "640x480_YUV411", "640x480_YUV422", "640x480_RGB8", "640x480_MONO8",
         "640x480_MONO16"]
REPLUGS, SIDE_BY_SIDE = 1000, 2
WARM_UP, CHUNK = 20, 20  # replugs of each camera
GROWN = 4096  # KiB
SANITIZED = "sanitized1394"
# Arguments: PORT GUID NAME COUNT. Each cycle waits for the first frame, then until program and kernel see the unplug.
LOOP = f"""n=0
while [ $n -lt $4 ]; do
    back=$(grep -c {FRAMES_COME} /tmp/said.$3) gone=$(grep -c unplugged /tmp/said.$3)
    /tmp/v4l iidc $1 $2 {iidc.WIDTH} {iidc.HEIGHT} {iidc.MS} /test/iidc counter < /dev/null > /dev/null 2>&1 &
    until [ $(grep -c {FRAMES_COME} /tmp/said.$3) -gt $back ]; do sleep 0.05; done
    kill $!
    wait $!
    until [ $(grep -c unplugged /tmp/said.$3) -gt $gone ]; do sleep 0.05; done
    while [ -e {iidc.in_kernel("$(($1 + 1))")} ]; do sleep 0.05; done
    n=$((n + 1))
done
"""


@pytest.fixture(scope="module")
def guest(boot: qemu.Boot, work: pathlib.Path, board: Machine) -> Iterator[Guest]:
    more: dict[str, pathlib.Path | str] = {"replug.sh": LOOP}
    if board.board == machine.DEV:
        more[SANITIZED] = guest_camera.sanitized_1394(work)
    with iidc.booted(boot, work, board, "camera-iidc-long", more) as running:
        yield running


def guid_of(port: int) -> str:
    return f"00b09d010000000{port}"


@pytest.mark.strict
def test_each_mode(guest: Guest) -> None:
    one = Camera(guest, ms=100)
    one.plug()
    for mode in MODES:
        grabber = Grabber(guest, f"-mode {mode} -rate 7.5", mode)
        grabber.wait(4)
        run = grabber.stop()
        size = {f"{frame.width}x{frame.height}" for frame in run.frames}
        assert (size, run.counters.lost["error"]) == ({mode.split("_")[0]}, 0), run.said
    one.unplug()


def test_parts_of_the_picture(guest: Guest) -> None:
    one = Camera(guest)
    one.plug()
    for left, top, width, height in [(0, 0, 176, 72), (4, 8, 64, 64), (112, 136, 64, 8)]:
        name = f"roi{left}"
        grabber = Grabber(guest, f"-format MONO8 -roi {left},{top},{width},{height}", name)
        grabber.wait(FRAMES)
        run = grabber.stop()
        pictures = [iidc.marked("MONO8", iidc.sent("MONO8", number)[top:top + height, left:left + width])
                    for number in range(FRAMES)]
        grey = bytes([128]) * (width * height // 2)
        assert wrong(run, camera.checksums([picture.tobytes() + grey for picture in pictures], width, height)) == []
    status, text = guest.shell().run(f"chpst -u {iidc.USER}:ddx timeout 3 {iidc.GRABBER} -roi 2,0,64,64 2>&1")
    assert "176x144, in steps of 4x4, at steps of 4x4" in text, status
    one.unplug()


@pytest.mark.strict
def test_two_cameras_are_two_instances(guest: Guest) -> None:
    """Each is found by its GUID; when one is unplugged, the other goes on."""
    cameras = [Camera(guest, port, guid_of(port)) for port in (0, 1)]
    for one in cameras:
        one.plug()
    grabbers = [Grabber(guest, f"-camera {one.guid} -format MONO8", f"eye{one.port}") for one in cameras]
    for grabber in grabbers:
        grabber.wait(FRAMES)
    cameras[0].unplug()
    grabbers[0].wait_said("unplugged")
    grabbers[1].wait_for_more()
    cameras[0].plug()
    grabbers[0].wait_for_more()
    runs = [grabber.stop() for grabber in grabbers]
    for run in runs:
        assert wrong(run, expected("MONO8", True)) == []
    assert runs[0].counters.lost["away"] > 0 == runs[1].counters.lost["away"]
    for one in cameras:
        one.unplug()


def start(guest: Guest, name: str, guid: str, program: str) -> None:
    guest.sh(f"chpst -u {iidc.USER}:ddx {program} -camera {guid} -format MONO8 -name {name} "
             f"-instance {iidc.GRABBER}.{name} > /tmp/run.{name} 2> /tmp/said.{name} & echo $! > /tmp/run.{name}.pid")


def memory(guest: Guest, name: str) -> tuple[int, int]:
    """KiB in use, and open files, while the camera is unplugged: the minimum of five samples, since the program opens
    files when it looks for the camera."""
    look = "grep VmRSS /proc/$pid/status; (set -- /proc/$pid/fd/*; echo $#)"
    found = guest.sh(f"read -r pid < /tmp/run.{name}.pid; for i in 1 2 3 4 5; do {look}; sleep 0.2; done").splitlines()
    return min(int(line.split()[1]) for line in found[0::2]), min(int(line) for line in found[1::2])


def replug(guest: Guest, names: list[str], count: int) -> None:
    """Replug each camera `count` times, in parallel: a replug mostly waits for the kernel's hub and the grabber."""
    loops = " ".join(f"(sh /test/replug.sh {port} {guid_of(port)} {name} {count} && touch /tmp/done.{name}) &"
                     for port, name in enumerate(names))
    done = " && ".join(f"[ -e /tmp/done.{name} ]" for name in names)
    guest.sh(f"rm -f /tmp/done.*; {loops} true")
    guest.wait_until(done, PATIENCE + 30 * count, pause=0.5)


def test_many_replugs_leak_nothing(guest: Guest, board: Machine, request: pytest.FixtureRequest,
                              record_property: Callable[[str, object], None]) -> None:
    """With AddressSanitizer where the image has the host's processor type. No error, no leak, and no more memory or
    open files at the end than after the first replugs."""
    names = [f"often{port}" for port in range(SIDE_BY_SIDE)]
    total = REPLUGS * int(request.config.getoption("seconds")) // SECONDS
    program = iidc.GRABBER
    if board.board == machine.DEV:
        guest.sh(f"cp /test/{SANITIZED} /tmp && chmod 755 /tmp/{SANITIZED}")
        program = f"env ASAN_OPTIONS=quarantine_size_mb=1 /tmp/{SANITIZED}"
    for port, name in enumerate(names):
        start(guest, name, guid_of(port), program)
    each, first = total // SIDE_BY_SIDE, min(WARM_UP, total // SIDE_BY_SIDE)
    replug(guest, names, first)
    before = [memory(guest, name) for name in names]
    record_property("after the first replugs: KiB, files", before)
    for at in range(first, each, CHUNK):
        replug(guest, names, min(CHUNK, each - at))
        record_property(f"after {min(at + CHUNK, each)} of each", [memory(guest, name) for name in names])
    after = [memory(guest, name) for name in names]
    for name in names:
        iidc.end(guest, f"/tmp/run.{name}.pid")
        said = guest.sh(f"cat /tmp/said.{name}")
        assert "Sanitizer" not in said and "runtime error" not in said, said[-3000:]
        assert said.count("unplugged") == each and said.count("back after") == each - 1
        counted = counters.of(f"{iidc.GRABBER}.{name}", guest.sh(f"cat /tmp/run.{name}"))[0]
        assert counted.frames_in == counted.out + counted.lost_total
    for (kib, files), (kib_after, files_after) in zip(before, after):
        assert kib_after < kib + GROWN and files_after <= files, (before, after)
