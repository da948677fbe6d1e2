# SPDX-License-Identifier: GPL-2.0-or-later
"""ddxvideoplay, judged by the screen: whole pictures, in order; and the console after it has exited."""
import base64
import functools
import re
import time
from collections.abc import Callable, Iterator

import numpy
import pytest
from numpy.typing import NDArray

from lib.seen import Image as Picture
from lib.seen import Seen, glyphs, ppm
from parts.common import PATIENCE, Failed
from parts.guest import session
from parts.guest.channel import END
from parts.guest.qemu import Guest
from parts.media import clip

pytestmark = pytest.mark.retry

PLAY, ITEM = "ddxvideoplay", "screen"
SETTINGS = f"/data/ddx/{PLAY}.conf"
DUMPS = 30  # screens with different frames
PIXELS = "fit=pixels\\ntext=off\\n"
PIECE = 16384
PAUSE = 0.02  # s that the guest runs between screen dumps
LENGTH = clip.SHORT * clip.RATE
BAND = 8   # rows; each band is compared with the neighbours of the expected frame
NEAR = 2   # frames
COLOUR = (124, 136)  # U, V
ALARM = (0xff, 0xc0, 0x20)
SINCE = r"{} since \d\d:\d\d:\d\d \(\d+ s\)"


def place(screen: Picture, pixels: bool) -> tuple[int, int, int, int]:
    """The position of the clip's picture: left, top, width, height."""
    height, width = screen.shape[:2]
    scale = 1 if pixels else min(width / clip.WIDTH, height / clip.HEIGHT)
    wide, high = int(clip.WIDTH * scale + 1e-6), int(clip.HEIGHT * scale + 1e-6)
    return (width - wide) // 2, (height - high) // 2, wide, high


def sample(screen: Picture, pixels: bool = False) -> Picture:
    """The picture on the screen, scaled back to the clip's size by taking the middle of each pixel."""
    left, top, wide, high = place(screen, pixels)
    columns = left + ((numpy.arange(clip.WIDTH) + 0.5) * wide / clip.WIDTH).astype(int)
    rows = top + ((numpy.arange(clip.HEIGHT) + 0.5) * high / clip.HEIGHT).astype(int)
    picture: Picture = screen[rows][:, columns]
    return picture


def number(picture: Picture) -> int | None:
    luma = picture @ numpy.array([0.299, 0.587, 0.114])
    return clip.frame_number(luma.astype(numpy.uint8).tobytes(), clip.WIDTH, clip.HEIGHT)


@functools.cache
def expected(frame: int) -> NDArray[numpy.float64]:
    """Each second pixel of a frame of the clip, as colours."""
    data = numpy.frombuffer(clip.picture(frame), numpy.uint8).astype(float)
    size = clip.WIDTH * clip.HEIGHT
    luma = data[:size].reshape(clip.HEIGHT, clip.WIDTH)[::2, ::2] * 1.164 - 18.6
    blue, red = (data[size:].reshape(2, clip.HEIGHT // 2, clip.WIDTH // 2) - 128)
    rgb = numpy.dstack([luma + 1.596 * red, luma - 0.813 * red - 0.391 * blue, luma + 2.018 * blue])
    return rgb.clip(0, 255)


def torn(picture: Picture, frame: int) -> list[int]:
    """Rows that show another frame than the number at the top."""
    near = [(frame + step) % LENGTH for step in range(-NEAR, NEAR + 1)]
    errors = numpy.array([numpy.abs(picture[::2, ::2] - expected(one)).mean(axis=(1, 2)) for one in near])
    bands = errors.reshape(len(near), -1, BAND).sum(axis=2)
    return [2 * BAND * int(band) for band in numpy.flatnonzero(bands.argmin(axis=0) != NEAR)]


# ---- The text ----

def alarm(screen: Picture) -> str:
    """The last line on the screen if it has the colour of alarms; otherwise empty."""
    height, scale = screen.shape[0], 2
    top = height - 10 * scale
    found = ""
    for left in range(2 * scale, screen.shape[1] - 6 * scale, 6 * scale):
        cell = screen[top:top + 9 * scale:scale, left:left + 5 * scale:scale]
        dots = (cell == ALARM).all(axis=2)
        found += glyphs().get("".join("#" if dot else "." for dot in dots.flatten()).encode(), "?")
    return found.rstrip()


def is_grey(picture: Picture) -> bool:
    """Whether the upper half, where no text is, is grey."""
    upper = picture[:len(picture) // 2]
    return bool((upper.max(axis=2).astype(int) - upper.min(axis=2) <= 2).all())


def wait_for_alarm(guest: Guest, text: str) -> Picture:
    """Wait until the screen shows this alarm ("": none), and return the screen."""
    deadline = time.monotonic() + PATIENCE
    while True:
        screen = ppm(guest.screen())
        said = alarm(screen)
        if re.fullmatch(text, said):
            return screen
        if time.monotonic() > deadline:
            raise Failed(f"the screen shows {said!r}, not {text!r}")
        time.sleep(5 * PAUSE)


def wait_for_frame(guest: Guest, other: int | None, pixels: bool = False) -> Picture:
    """Wait for a screen that shows a frame of the clip, but not `other`."""
    end = time.monotonic() + PATIENCE
    while number(sample(screen := ppm(guest.screen()), pixels)) in (None, other):
        if time.monotonic() > end:
            raise Failed(f"no other picture; {guest.sh(f'cat /run/log/{PLAY}/current')}")
        time.sleep(PAUSE)
    return screen


# ---- Programs in the guest ----

def start(guest: Guest, settings: str = "", name: str = ITEM) -> Picture:
    """Start the service with these settings unless it runs with them; return a screen with a picture of the clip."""
    text = f"enabled=yes\\nname={name}\\n{settings}"
    guest.sh(f"printf '{text}' > /tmp/{PLAY}; pidof {PLAY} && cmp -s /tmp/{PLAY} {SETTINGS} || "
             f"{{ cp /tmp/{PLAY} {SETTINGS}; /etc/init.d/S*{PLAY} restart; }}")
    wait_for_frame(guest, None, "pixels" in settings)
    return wait_for_alarm(guest, "")  # late frames are grey on a slow machine


def console_of(guest: Guest) -> Picture:
    """The screen with a line of text on the console (this card's driver forgets the old text). The kernel draws text
    with a delay: wait until two dumps in a row are equal."""
    guest.wait_until("[ -e /run/late.done ]")  # the card's driver takes the console over
    guest.sh("printf '\\033[2J\\033[Hconsole\\033[?25l' > /dev/tty1")
    shown, same, end = ppm(guest.screen()), False, time.monotonic() + PATIENCE
    while not (same and shown.any() and is_grey(shown)) and time.monotonic() < end:
        time.sleep(10 * PAUSE)
        before, shown = shown, ppm(guest.screen())
        same = numpy.array_equal(before, shown)
    return shown


def fetch(guest: Guest, path: str, at: int) -> bytes:
    """A piece of a guest's file: the console drops output that is too long."""
    return base64.b64decode(guest.sh(f"dd if={path} bs={PIECE} skip={at} count=1 2> /dev/null | base64"))


def difference(guest: Guest, shown: Picture, item: str, places: tuple[float, ...] = (0, 0.5, 1)) -> int:
    """The largest difference between the screen and a snapshot of the item, in rows at these heights (1: bottom)."""
    guest.sh(f"ddxvideosnap -name {item} /tmp/still.ppm")
    left, top, wide, high = place(shown, pixels=True)
    ours = shown[top:top + high, left:left + wide].tobytes()
    head = int(guest.sh("stat -c %s /tmp/still.ppm")) - len(ours)
    found = 0
    for at in (int(height * (len(ours) // PIECE)) for height in places):
        piece = numpy.frombuffer(fetch(guest, "/tmp/still.ppm", at)[0 if at else head:], numpy.uint8)
        begin = at * PIECE - head if at else 0
        same = numpy.frombuffer(ours[begin:begin + len(piece)], numpy.uint8)
        found = max(found, int(numpy.abs(piece.astype(int) - same).max()))
    return found


def load(guest: Guest, options: str, name: str = ITEM) -> None:
    guest.sh(f"ddxvideoload {options} -name {name} -instance {name} > /tmp/{name} 2>&1 & echo $! > /tmp/{name}.pid")


@pytest.fixture(scope="module")
def console(guest: Guest, recorded: session.Result) -> Picture:
    """The screen before any program has drawn."""
    return console_of(guest)


@pytest.fixture(scope="module")
def screen(guest: Guest, console: Picture) -> Iterator[Guest]:
    """The guest, with the clip played in a loop in an item without a recorder."""
    load(guest, "/test/clip.y4m -loop")
    yield guest
    guest.sh(f"/etc/init.d/S*{PLAY} stop; rm -f {SETTINGS}; kill -9 $(cat /tmp/{ITEM}.pid); true")


def watch(guest: Guest, dumps: int, seconds: float = PATIENCE) -> None:
    """Check that `dumps` frames are whole and none goes backwards."""
    seen: list[int] = []
    end = time.monotonic() + seconds
    while len(set(seen)) < dumps:
        assert time.monotonic() < end, f"frames {seen}"
        time.sleep(PAUSE)
        picture = sample(ppm(guest.screen()))
        frame = number(picture)
        assert frame is not None, "torn: no number"
        assert torn(picture, frame) == [], f"torn in frame {frame}"
        step = (frame - seen[-1]) % LENGTH if seen else 0
        assert step < LENGTH / 2, f"frame {frame} after frame {seen[-1] % LENGTH}: backwards"
        seen.append(seen[-1] + step if seen else frame)
    written = int(guest.sh(f"ddxctl show {ITEM}.frame | tr -cd '0-9\\n' | tail -n 1"))
    assert seen[-1] <= written


def test_each_picture_is_whole_and_newer(screen: Guest) -> None:
    start(screen)
    watch(screen, DUMPS)


def test_a_writer_that_stops(screen: Guest) -> None:
    start(screen)
    loader = screen.sh(f"cat /tmp/{ITEM}.pid")
    assert not is_grey(wait_for_alarm(screen, ""))
    screen.sh(f"kill -STOP {loader}")
    assert is_grey(wait_for_alarm(screen, SINCE.format("no frame")))
    screen.sh(f"kill -9 {loader}")
    assert is_grey(wait_for_alarm(screen, SINCE.format("no writer")))
    load(screen, "/test/clip.y4m -loop")
    assert not is_grey(wait_for_alarm(screen, ""))


def test_pixels_equal_those_of_a_snapshot(screen: Guest) -> None:
    shown = start(screen, PIXELS)
    frame = number(sample(shown, pixels=True))
    assert frame is not None, "torn: no number"
    size = clip.WIDTH * clip.HEIGHT * 3 // 2 + len("FRAME\n")
    one = "{ head -n 1; tail -c +" + str(frame * size + 1) + f" | head -c {size}; }}"
    screen.sh(f"{one} < /test/clip.y4m > /tmp/still.y4m")
    screen.sh("ddxvideoload /tmp/still.y4m -name still -instance still")
    assert difference(screen, shown, "still") <= 2


@pytest.mark.parametrize("layout", ["GREY16", "RGB24"])
def test_other_layouts(screen: Guest, layout: str) -> None:
    """A frame of one colour with the clip's luma; compared in the middle, away from edges, since 4:2:0 mixes the
    colours of neighbours."""
    size, head = clip.WIDTH * clip.HEIGHT, len("FRAME\n")
    screen.sh("{ head -n 1; head -c " + str(size + head) + "; } < /test/clip.y4m > /tmp/tinted.y4m")
    for value in COLOUR:
        screen.sh(f"head -c {size // 4} /dev/zero | tr '\\0' '\\{value:o}' >> /tmp/tinted.y4m")
    name = layout.lower()
    load(screen, f"/tmp/tinted.y4m -loop -layout {layout}", name)
    try:
        assert difference(screen, start(screen, PIXELS, name), name, (0.5,)) <= 2
    finally:
        screen.sh(f"kill $(cat /tmp/{name}.pid)")


@pytest.mark.parametrize(("signal", "settings"), [("TERM", ""), ("KILL", PIXELS)])
def test_the_console_is_restored_on_exit(screen: Guest, console: Picture, signal: str, settings: str) -> None:
    start(screen, settings)
    screen.sh(f"sv once /run/service/{PLAY}; pid=$(cat /run/service/{PLAY}/supervise/pid); kill -{signal} $pid; "
              f"while kill -0 $pid 2> /dev/null; do sleep 0.02; done")
    assert console.any() and is_grey(console)
    assert (console_of(screen) == console).all()


def view(guest: Guest, condition: Callable[[Seen], object]) -> Seen:
    """Wait until what the viewer shows meets the condition."""
    deadline = time.monotonic() + PATIENCE
    while not condition(seen := Seen(ppm(guest.screen()))):
        if time.monotonic() > deadline:
            raise Failed(f"the viewer shows {seen.text!r}; {guest.sh('cat /tmp/view.log')}")
        time.sleep(PAUSE)
    return seen


def test_the_viewer_uses_screen_and_keyboard(screen: Guest, console: Picture) -> None:
    """In the background of a terminal without the keyboard; in the foreground with it."""
    screen.sh(f"/etc/init.d/S*{PLAY} stop")
    mode = screen.sh("stty -g < /dev/tty")
    screen.sh(f"ddxvideoview -name {ITEM} < /dev/tty > /tmp/view.log 2>&1 & echo $! > /tmp/view.pid")
    seen = view(screen, lambda seen: seen.label == "LIVE")
    assert number(sample(seen.area)) == (seen.frame() or 0) % LENGTH, seen.text
    assert screen.sh("stty -g < /dev/tty") == mode
    screen.sh("kill $(cat /tmp/view.pid); wait $(cat /tmp/view.pid)")

    terminal = screen.shell("hvc1")
    terminal.begin(f"ddxvideoview -name {ITEM} < /dev/tty > /tmp/view.log 2>&1")
    view(screen, lambda seen: seen.label == "LIVE")
    terminal.send(" ")
    paused = view(screen, lambda seen: seen.label == "PAUSED" and seen.newer() >= 2)
    first = at = paused.frame()
    for _ in range(2):
        terminal.send(".")
        forward = view(screen, lambda seen: seen.frame() != at)
        assert forward.frame_before() == at, forward.text
        at = forward.frame()
    terminal.send(",,")
    back = view(screen, lambda seen: seen.frame() == first)
    assert back.label == "PAUSED" and number(sample(back.area)) == (first or 0) % LENGTH
    terminal.send("q")
    terminal.wait(END)  # earlier keys go to the viewer
    assert terminal.run(f"[ \"$(stty -g < /dev/tty)\" = {mode} ]") == (0, "")
    assert (console_of(screen) == console).all()


def test_frames_come_again_after_the_store_was_killed(screen: Guest) -> None:
    """Uses its own store, since other programs need the image's. Frames go on without the store."""
    def run(command: str) -> None:
        name = command.split()[0]
        screen.sh(f"(cd /tmp/own && DDX_DIR=/tmp/own exec chpst -u ddxplay:ddx {command} > {name}.log 2>&1) & "
                  f"echo $! > /tmp/own/{name}.pid")

    screen.sh(f"/etc/init.d/S*{PLAY} stop; mkdir -p /tmp/own && chown ddxplay:ddx /tmp/own")
    run(f"{PLAY} -name {ITEM}")
    try:
        wait_for_alarm(screen, SINCE.format("no store"))
        run("store -m 8M")
        wait_for_alarm(screen, SINCE.format("no item"))
        run(f"ddxvideoload /test/clip.y4m -loop -name {ITEM}")
        wait_for_alarm(screen, "")
        screen.sh("kill -9 $(cat /tmp/own/store.pid)")  # the holder; its worker dies with it
        first = wait_for_alarm(screen, SINCE.format("no store"))
        wait_for_frame(screen, number(sample(first)))
        assert not is_grey(first) and alarm(ppm(screen.screen()))
        run("store -m 8M")
        assert not is_grey(wait_for_alarm(screen, ""))
    finally:
        screen.sh("kill -9 $(cat /tmp/own/*.pid) $(pgrep -P $(cat /tmp/own/store.pid)); rm -r /tmp/own")
