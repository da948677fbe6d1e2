# SPDX-License-Identifier: GPL-2.0-or-later
"""The verdict of `make run`: correct runs pass, and each wrong picture, gap and counter is found."""
import filecmp
import json
import pathlib
import re

import numpy
import pytest
from numpy.typing import NDArray

from parts.common import TOP
from parts.guest import camera_run, stream, testdisk
from parts.guest.stream import Picture
from parts.media import clip as default_clip, report, y4m
from parts.media.counters import Counters
from parts.media.likeness import Likeness
from parts.media.recording import FileSystem
from parts.media.report import About, Report, Stage

pytestmark = pytest.mark.retry

MS = 1_000_000
PERIODS = 5  # camera periods that each frame of the clip is shown for


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    path = tmp_path_factory.mktemp("run") / "clip.y4m"
    path.write_bytes(b"YUV4MPEG2 W352 H288 F25:1 C420jpeg\n"
                     + b"".join(b"FRAME\n" + default_clip.picture(number) for number in range(4)))
    return path


def looped(path: pathlib.Path, frames: list[tuple[int, int]]) -> pathlib.Path:
    """Write a recording of frames (ms, number of the clip's frame)."""
    path.write_bytes(b"YUV4MPEG2 W352 H288 F25:1 C420jpeg\n" + b"".join(
        f"FRAME XTIME={at * MS}\n".encode() + default_clip.picture(number) for at, number in frames))
    return path


def shown() -> list[tuple[int, int]]:
    return [(40 * index, index // PERIODS) for index in range(4 * PERIODS)]


def counters(name: str, out: int, lost: int = 0) -> Counters:
    return Counters(name, out + lost, out, 0, {"driver": lost}, {"p50": 5, "p99": 9, "max": 10})


def camera(clip: pathlib.Path, path: pathlib.Path, frames: list[tuple[int, int]], driver: int = 0,
           times: tuple[int, ...] = (0, 200, 400, 600)) -> list[str]:
    recording = looped(path, frames)
    grab, save = counters("grab", len(frames), driver), counters("save", len(frames))
    result = camera_run.judge(clip, recording, grab, save, list(times))
    assert result.good == (not result.disagreements)
    return result.disagreements


def test_a_camera_is_judged_by_the_frames_that_were_due(clip: pathlib.Path, tmp_path: pathlib.Path) -> None:
    path = tmp_path / "recorded.y4m"
    assert not camera(clip, path, shown())
    assert not camera(clip, path, shown()[:7] + shown()[10:], driver=3)
    assert "missing by the time stamps: 3" in camera(clip, path, shown()[:7] + shown()[10:])[0]
    back = shown()
    back[18] = (back[18][0], 0)  # an old picture
    assert "1 recorded frames that were not due" in camera(clip, path, back)[0]
    late = [(at, min(number, 1)) for at, number in shown()]  # the output was late, or the camera stuck
    assert "5 recorded frames that were not due" in camera(clip, path, late)[0]
    assert not camera(clip, path, late, times=(0, 200, 700, 800))
    # The output was delayed and catches up: the camera sees the newest frame slightly before it is due.
    quick = [(at, 0 if at < 200 else 1 if at < 560 else 3) for at, _ in shown()]
    assert not camera(clip, path, quick, times=(0, 200, 590, 595))
    path.write_bytes(looped(path, quick).read_bytes().replace(b"XTIME=0\n", b"XTIME=0 XDDX_START=7000000000\n"))
    at_once, shifted = ([one + 7000 for one in times] for times in ((0, 200, 590, 595), (0, 500, 590, 895)))
    assert camera_run.compare(clip, path, at_once)[1] == []  # judged by the clock, not by the first sight of frame 1
    assert len(camera_run.compare(clip, path, shifted)[1]) > 3
    strange = shown()
    strange[3] = (strange[3][0], 77)  # no frame of the clip
    assert "not due" in camera(clip, path, strange)[0]
    assert "rising" in camera(clip, path, [*shown()[:5], shown()[4], *shown()[6:]])[0]


def test_a_stream_is_judged_by_the_recording_of_the_same_time() -> None:
    source = [Picture(40 * MS * index, index // 2) for index in range(40)]
    seen = [Picture(one.time - source[7].time + 3000, one.number) for one in source[7:] if one.time % 3]
    assert stream.unlike(seen, source) == []
    frozen = [Picture(one.time, seen[min(index, 12)].number) for index, one in enumerate(seen)]
    assert stream.unlike(frozen, source)[-1] == len(seen) - 1
    assert len(stream.unlike(frozen, source)) >= len(seen) - 15
    blank = [*seen[:5], Picture(seen[5].time, None), *seen[6:]]
    assert stream.unlike(blank, source) == [5]
    assert stream.unlike([Picture(0, None)], source) == [0]


def test_pictures_missed_by_decode_are_found(clip: pathlib.Path) -> None:
    good = stream.judge(clip, clip, counters("send", 4), counters("ddxdecode", 4), counters("save", 4))
    assert len(good.shown) == 4 and not good.disagreements
    bad = stream.judge(clip, clip, counters("send", 5), counters("ddxdecode", 4), counters("save", 3))
    assert len(bad.disagreements) == 2


COUNT, AFTER = 40, 3  # pictures of a clip without numbers; ddxdecode starts with the fourth
Pictures = list[NDArray[numpy.uint8]]


def waves(speed: int) -> Pictures:
    """A clip without numbers, 160x96."""
    y, x = numpy.mgrid[0:96, 0:160]
    return [(128 + 90 * numpy.sin((x + speed * number) / 5) * numpy.cos(y / 7)).astype(numpy.uint8)
            for number in range(COUNT)]


def coded(pictures: Pictures) -> Pictures:
    """The pictures with errors like those of a lossy codec."""
    noise = numpy.random.default_rng(1)
    return [numpy.clip(one + noise.normal(0, 12, one.shape), 0, 255).astype(numpy.uint8) for one in pictures]


def unnumbered(path: pathlib.Path, pictures: Pictures, begin: int) -> pathlib.Path:
    """Write a recording at 30000/1001 frames a second whose times start with that of picture `begin`."""
    chroma = bytes([128]) * (160 * 96 // 2)
    with path.open("wb") as file:
        file.write(b"YUV4MPEG2 W160 H96 F30000:1001 C420jpeg\n")
        for index, one in enumerate(pictures):
            start = f" XDDX_START={7000 * MS + begin * 33366667 + (3000 if begin else 0)}" if not index else ""
            file.write(f"FRAME XTIME={index * 33366667}{start}\n".encode() + one.tobytes() + chroma)
    return path


def streamed(folder: pathlib.Path, source: Pictures, seen: Pictures) -> stream.Result:
    recorded = unnumbered(folder / "recorded.y4m", source, 0)
    shown_file = unnumbered(folder / "shown.y4m", seen, AFTER)
    found = stream.judge(shown_file, recorded, counters("send", len(seen)), counters("ddxdecode", len(seen)),
                         counters("save", len(seen)))
    assert not found.disagreements and found.likeness
    return found


def test_a_clip_without_numbers_is_judged_by_its_pictures(tmp_path: pathlib.Path) -> None:
    source = waves(2)
    seen = coded(source)
    right = streamed(tmp_path, source, seen[AFTER:])
    assert right.wrong == [] and right.likeness and right.likeness.told == COUNT - AFTER
    assert 25 < min(right.likeness.psnr) and "to show a shift by one frame" in right.likeness.words()
    for by in (-1, 1):
        shifted = streamed(tmp_path, source, seen[AFTER + by:][:COUNT - AFTER - 1])
        assert len(shifted.wrong) == COUNT - AFTER - 1, by
    once, grey = list(seen), numpy.full_like(source[0], 128)
    once[20], once[30] = seen[19], grey
    assert streamed(tmp_path, source, once[AFTER:]).wrong == [20 - AFTER, 30 - AFTER]


def test_a_still_clip_is_reported_as_hard_to_judge(tmp_path: pathlib.Path) -> None:
    source = waves(0)
    found = streamed(tmp_path, source, coded(source)[AFTER:])
    assert found.wrong == [] and found.likeness and found.likeness.told == 0
    assert "a shift by one frame can hardly be seen" in found.likeness.words()


def test_noise_that_the_codec_destroys_is_not_judged(tmp_path: pathlib.Path) -> None:
    """A low bit rate destroys it, and a correct stream must not be called wrong."""
    random = numpy.random.default_rng(1)
    source = [random.integers(0, 256, picture.shape, numpy.uint8) for picture in waves(0)]
    seen = [(picture // 16 + 120).astype(numpy.uint8) for picture in source]
    found = streamed(tmp_path, source, seen[AFTER:])
    assert found.wrong == [] and found.likeness and found.likeness.psnr[0] < 15
    assert "too little of the pictures to tell them apart" in found.likeness.words()


def test_a_damaged_clip_is_named_with_its_frame(tmp_path: pathlib.Path) -> None:
    path = unnumbered(tmp_path / "my.y4m", waves(1)[:3], 0)
    whole = path.read_bytes()
    for damaged, words in [(whole[:-1], "my.y4m: cut short in frame 2 "),
                           (whole + b"FRAM", "my.y4m: no FRAME line where frame 3 "),
                           (b"RIFF", "my.y4m: no Y4M"), (b"YUV4MPEG2 Wx H2\n", "my.y4m: width or height")]:
        path.write_bytes(damaged)
        with pytest.raises(y4m.Malformed, match=words):
            list(y4m.read(path)[1])


@pytest.mark.strict
def test_the_keys_and_values_of_the_report() -> None:
    histogram = [0] * 736
    histogram[5], histogram[40], histogram[735] = 3, 2, 1
    stages = [Stage(name, 10 - index, index, counters(name, 10 - index, index), histogram)
              for index, name in enumerate(report.COLOURS)]
    seconds = [(float(second), {name: 25 * second for name in report.COLOURS}) for second in range(4)]
    about = About("0.2.0", "clip", "<disk>", "tcg", {"kernel_to_first_frame_s": 2.5}, Likeness([], [30.0]).figures())
    found = Report(10, stages, about, ["one <thing>"], seconds, False, ["a <note>"])
    values = json.loads(found.json())
    assert values["frames"] == {"in": 10, "stored": 10, "recorded": 9, "sent": 8, "decoded": 7}
    assert values["lost"] == {"store": 0, "record": 1, "send": 2, "stream": 3}
    assert values["latency_us"]["stream"] == {"p50": 5, "p99": 9, "max": 10}
    page = report.page(found)
    assert values["notes"] == ["a <note>"] and "a &lt;note&gt;" in page
    assert "Failed." in page and "Passed." not in page and not values["passed"]
    assert page.count(f">{report.SINCE['sent']}<") >= 2 and ">decoded</text>" in page
    assert "&lt;disk&gt;" in page and "one &lt;thing&gt;" in page and "src=" not in page and "href=" not in page
    assert page.count("<polyline") == 4 and page.count("<title>3</title>") == 4


def rows_of(page: str, title: str) -> dict[str, str]:
    """The text of each key in the table after this line."""
    rows = re.match(r"(?:\|.*\n)+", page.split(f"{title}\n\n")[1])
    assert rows
    cells = [line.strip("|").split("|", 1) for line in rows[0].splitlines()[2:]]
    return {key: words for keys, words in cells for key in re.findall(r"`(\w+)`", keys)}


@pytest.mark.parametrize("compared", [Likeness([], [30.0]).figures(), {"compared_by": "number"}])
def test_the_page_lists_each_key_of_the_report(compared: dict[str, object]) -> None:
    about = About("0.2.0", "clip", "disk.img", "tcg", {"kernel_to_first_frame_s": 2.5}, compared)
    stages = [Stage(name, 10, 0, counters(name, 10)) for name in report.COLOURS]
    values = json.loads(Report(10, stages, about, [], [], True).json())
    rows = rows_of((TOP / "docs/ci.md").read_text(), "The keys of `output/report.json`:")
    assert sorted(rows) == sorted(values)
    inside = [(key, one) for key, value in values.items() if isinstance(value, dict) for one in value]
    assert [(key, one) for key, one in inside if f"`{one}`" not in rows[key]] == []


def test_latency_buckets_match_ddx_stats() -> None:
    """ddx_stats.h: one bucket per µs below 32, then 32 per power of two, up to 2^27 µs."""
    assert [report.bucket_us(index) for index in (0, 31, 32, 63, 64, 95)] == [0, 31, 32.5, 63.5, 65, 127]
    assert 2**27 - 2**22 < report.bucket_us(735) < 2**27


def test_a_window_with_a_stalled_host_does_not_count() -> None:
    quick, slow = 300, 400  # buckets

    def marks(*late: int) -> list[list[int]]:
        """Windows of 100 frames with these numbers of late frames."""
        result = [[0] * 500]
        for count in late:
            result.append(list(result[-1]))
            result[-1][quick] += 100 - count
            result[-1][slow] += count
        return result

    def prompt(*late: int) -> float:
        return stream.percentile(stream.quieter(stream.windows(marks(*late))), 99)

    assert prompt(0, 80, 0, 0, 30, 0) == report.bucket_us(quick)
    assert prompt(2, 80, 2, 2, 30, 2) == report.bucket_us(slow)
    assert prompt(0) == report.bucket_us(quick) and prompt(2) == report.bucket_us(slow)


@pytest.mark.parametrize("megabytes", [1, 220])
def test_a_clip_of_any_size_fits_onto_its_disk(tmp_path: pathlib.Path, megabytes: int) -> None:
    """mke2fs' own share of the disk is not proportional: small disks have other rules."""
    clip = tmp_path / "clip.y4m"
    frame = b"FRAME\n" + bytes([17]) * (1280 * 720 * 3 // 2)
    with clip.open("wb") as file:
        file.write(b"YUV4MPEG2 W1280 H720 F25:1 C420jpeg\n")
        for _ in range(-(-(megabytes << 20) // len(frame))):
            file.write(frame)
    disk = testdisk.make(tmp_path / "test.img", clip, {"ddxvideoload.conf": "loop=\n"})
    taken = FileSystem(disk, None).take("clip.y4m", tmp_path / "taken.y4m")
    assert filecmp.cmp(clip, taken, shallow=False)
