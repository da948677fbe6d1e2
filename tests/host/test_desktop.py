# SPDX-License-Identifier: GPL-2.0-or-later
"""`make desktop`, and the examples built and run with its installation."""
from __future__ import annotations

import json
import pathlib
import re
import shutil
import subprocess
from typing import Any

import numpy as np
import pytest

from parts.common import MORTAL
from parts.image import native

from .programs import (TOP, Desk, make_clip, pictures, read_y4m, result, start_recorder, stop, times, wait_until)

pytestmark = pytest.mark.retry

PYTHON = ["/usr/bin/python3", "-B"]


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    folder = tmp_path_factory.mktemp("desktop")
    (folder / "opt/ddx/share/man").mkdir(parents=True)
    (folder / "opt/ddx/share/man").chmod(0o2775)
    subprocess.run(["make", "-s", "desktop", "PREFIX=/opt/ddx", f"DESTDIR={folder}"], cwd=TOP, check=True, timeout=600,
                   umask=0o077)
    return folder


def test_desktop_stays_below_its_prefix(installed: pathlib.Path) -> None:
    files = {str(path.relative_to(installed)) for path in installed.rglob("*") if path.is_file()}
    assert all(name.startswith("opt/ddx/") for name in files)
    names = {pathlib.Path(name).name for name in files}
    assert {"ddxstore", "store", "ddxctl", "ddxvideosave", "ddx.h", "ddxvideo.h", "libddx.so", "ddx.pc", "ddxvideo.pc",
            "ddx.py", "ddxvideo.py", "ddxvideocalib", "ddxvideoview"} <= names
    entry = (installed / "opt/ddx/share/applications/ddxvideoview.desktop").read_text()
    assert "Exec=/opt/ddx/bin/ddxvideoview %f" in entry.splitlines()
    assert not [name for name in files if "init.d" in name or "default" in name]


def test_desktop_is_for_all_users_and_leaves_folders_as_they_are(installed: pathlib.Path) -> None:
    """Whatever the user's umask is."""
    there = installed / "opt/ddx/share/man"
    assert there.stat().st_mode & 0o7777 == 0o2775
    assert not [path for path in (installed / "opt/ddx").rglob("*")
                if not path.is_symlink() and path.stat().st_mode & 0o044 != 0o044]


def test_each_installed_program_has_a_page_for_man(installed: pathlib.Path) -> None:
    prefix = installed / "opt/ddx"
    programs = {path.name for path in (prefix / "bin").iterdir()}
    assert len(programs) > 10 and {path.stem for path in (prefix / "share/man/man1").iterdir()} == programs
    found = subprocess.run(["man", "-M", prefix / "share/man", "-P", "cat", "ddx_store_item_type"], capture_output=True,
                           text=True, check=True, env={"PATH": "/usr/bin:/bin", "LC_ALL": "C"})
    assert "ddx_store_item_name, ddx_store_item_type" in found.stdout


@pytest.fixture
def environment(desk: Desk, installed: pathlib.Path) -> dict[str, str]:
    """The environment of a developer with that prefix; Python finds the library without it."""
    prefix = installed / "opt/ddx"
    library = next(prefix.glob("lib/**/libddx.so")).parent
    return {**{name: value for name, value in desk.environment.items() if name != "LD_LIBRARY_PATH"},
            "PKG_CONFIG_SYSROOT_DIR": str(installed), "PKG_CONFIG_PATH": str(library / "pkgconfig"),
            "PYTHONPATH": str(next(prefix.glob("lib/python*/**/ddx.py")).parent)}


def libraries(installed: pathlib.Path) -> dict[str, str]:
    """The library path for compiled programs, which search below the prefix, without the test's DESTDIR."""
    return {"LD_LIBRARY_PATH": str(next((installed / "opt/ddx").glob("lib/**/libddx.so")).parent)}


def test_a_program_finds_its_library_below_the_prefix(installed: pathlib.Path, tmp_path: pathlib.Path) -> None:
    """By its RUNPATH; /usr/local needs none, since the dynamic linker searches there."""
    folder = next((installed / "opt/ddx").glob("lib/**/ddx.pc")).parent
    environment = {"PATH": "/usr/bin:/bin", "PKG_CONFIG_PATH": str(folder)}
    flags = subprocess.run(["pkg-config", "--libs", "ddx"], env=environment, capture_output=True, text=True, check=True)
    assert f"-Wl,-rpath,/opt/ddx/{folder.parent.relative_to(installed / 'opt/ddx')}" in flags.stdout.split()
    usual = subprocess.run(["pkg-config", "--libs", "ddx"], capture_output=True, text=True, check=True, env={
        **environment, "PKG_CONFIG_PATH": str(native.build() / native.LIBRARIES / "pkgconfig")})
    assert "rpath" not in usual.stdout


def test_pip_installs_the_modules(tmp_path: pathlib.Path) -> None:
    """From a copy, since setuptools writes into the source folder."""
    shutil.copytree(TOP / "package/ddx/python", tmp_path / "source")
    subprocess.run(["/usr/bin/python3", "-m", "pip", "install", "-q", "--no-index", "--no-deps", "--no-build-isolation",
                    "--root-user-action=ignore", "--target", tmp_path / "site", tmp_path / "source"], check=True)
    assert {"ddx.py", "ddxvideo.py"} <= {path.name for path in (tmp_path / "site").iterdir()}
    about = next((tmp_path / "site").glob("ddx-*.dist-info/METADATA")).read_text()
    assert "Requires-Dist: numpy" in about


def test_examples_of_the_manual(desk: Desk, installed: pathlib.Path, environment: dict[str, str],
                                tmp_path: pathlib.Path) -> None:
    """Run with a clip whose pictures are known."""
    flags = subprocess.run(["pkg-config", "--cflags", "--libs", "ddx"], env=environment, capture_output=True, text=True,
                           check=True).stdout.split()
    program = tmp_path / "reader"
    subprocess.run(["gcc", "-Wall", "-Wextra", "-Werror", TOP / "examples/reader.c", "-o", program, *flags], check=True)
    clip = make_clip(tmp_path / "clip.y4m", frames=10)
    sums = [sum(picture[:352 * 288]) for picture in pictures(clip)]

    nothing = subprocess.run([program], env={**environment, **libraries(installed)}, capture_output=True, text=True,
                             check=False)
    assert nothing.returncode == 1 and nothing.stderr == "video: No such file or directory\n"
    # The item exists from its first writer on, so that both readers find it.
    assert desk.run("ddxvideoload", clip).returncode == 0
    # Each exits after a second without a frame, and keeps one frame: start the slower one first, with a slow clip.
    readers = []
    for command in [*PYTHON, str(TOP / "examples/reader.py")], [str(program)]:
        readers.append(subprocess.Popen([*MORTAL, *command], env={**environment, **libraries(installed)},
                                        stdout=subprocess.PIPE, text=True))
        wait_until(lambda: f'"readers":{len(readers)},' in desk.run("ddxctl", "list", "--json").stdout)
    loader = desk.run("ddxvideoload", clip, "-readers", "2", "-rate", "0.2")
    assert loader.returncode == 0, loader.stderr
    for reader in readers:
        out, _ = reader.communicate(timeout=60)
        lines = [[int(word) for word in line.split()] for line in out.splitlines()]
        assert reader.returncode == 0
        assert [line[3] for line in lines] == sums
        assert [line[0] for line in lines] == list(range(11, 21)) and [line[2] for line in lines] == [0] * 10
        assert [line[1] for line in lines] == sorted({line[1] for line in lines})


@pytest.mark.parametrize("name, language", [("reader.c", "c"), ("reader.py", "python")])
def test_the_manual_shows_the_examples(name: str, language: str) -> None:
    _, text = (TOP / "examples" / name).read_text().split("\n", 1)  # without the licence line
    assert f"```{language}\n{text}```\n" in (TOP / "docs/store.md").read_text()
    assert len(text.splitlines()) <= 22


@pytest.mark.parametrize("name, language", [("edges/edges.cpp", "cpp"), ("blob.py", "python")])
def test_the_manual_quotes_the_examples(name: str, language: str) -> None:
    """The quoted part equals the example."""
    section = re.search(r"\n## Video from your own program\n.*?\n## ", (TOP / "docs/store.md").read_text(), re.DOTALL)
    assert section
    quoted = re.findall(rf"```{language}\n(.*?)```\n", section[0], re.DOTALL)
    assert len(quoted) == 1 and quoted[0] in (TOP / "examples" / name).read_text()


def test_python_s_help_names_both_times(environment: dict[str, str]) -> None:
    """The time when a frame was written, and when its picture was captured."""
    shown = subprocess.run([*PYTHON, "-c", "import ddx; help(ddx)"], env=environment, capture_output=True, text=True,
                           check=True).stdout
    for text in shown, *((TOP / "docs" / page).read_text() for page in ("store.md", "logging.md")):
        assert "frame.time" in text and 'time=frame["time"]' in text


def test_the_video_library_calls_no_ffmpeg(installed: pathlib.Path) -> None:
    """As docs/licences.md promises, so that a closed program may link to it."""
    library = next((installed / "opt/ddx").glob("lib/**/libddxvideo.a"))
    needed = subprocess.run(["nm", "--undefined-only", library], capture_output=True, text=True, check=True).stdout
    assert "ddx_store_create" in needed and not re.search(r"\b(av|sws|swr)", needed)


def newest(desk: Desk, item: str) -> dict[str, Any]:
    """The newest value of an item with its time; empty if there is none."""
    shown = desk.run("ddxctl", "show", item, "--json")
    return dict(json.loads(shown.stdout)) if shown.returncode == 0 else {}


def play(desk: Desk, clip: pathlib.Path, command: list[str], environment: dict[str, str], item: str) -> None:
    """Play a clip to an example until the newest value that it wrote belongs to the clip's last picture."""
    last = len(pictures(clip)) - 1
    loader = desk.start("ddxvideoload", clip, "-readers", "2")
    original = start_recorder(desk, "-output", desk.folder / "video.y4m")
    example = subprocess.Popen([*MORTAL, *command], env=environment, stderr=subprocess.PIPE, text=True)

    def seen() -> bool:
        value = newest(desk, item)
        return bool(value) and value["value"]["frame"] == last

    wait_until(lambda: seen() or example.poll() is not None)
    example.terminate()
    said = example.communicate()[1]
    assert seen(), said
    assert result(loader)[0] == 0 and stop(original)[0] == 0


def stamps(path: pathlib.Path) -> list[int]:
    """The capture time of each picture, ns: the time of the first plus the distance to it."""
    first = next(line for line, picture in read_y4m(path) if picture)
    start = re.search(r"XDDX_START=(\d+)", first)
    assert start, first
    return [int(start[1]) + passed for passed in times(path)]


def test_the_program_in_the_readme(desk: Desk, environment: dict[str, str], tmp_path: pathlib.Path) -> None:
    """Each mean luminance that it prints is that of the clip's picture."""
    block = re.search(r"```python\n(.*?)```", (TOP / "README.md").read_text(), re.S)
    assert block
    clip = make_clip(tmp_path / "clip.y4m", frames=5)
    means = [np.frombuffer(picture, np.uint8)[:352 * 288].mean() for picture in pictures(clip)]
    program = subprocess.Popen([*MORTAL, *PYTHON, "-u", "-c", block[1]], env=environment, stdout=subprocess.PIPE,
                               text=True)
    loader = desk.start("ddxvideoload", clip, "-readers", "1", "-rate", "0.2")
    assert program.stdout
    for number, mean in enumerate(means):
        words = program.stdout.readline().split()
        assert (int(words[0]), words[2:]) == (number, ["missed", "0"]) and abs(float(words[1]) - mean) < 1e-9
    program.terminate()
    program.communicate()
    assert result(loader)[0] == 0


@pytest.mark.strict
def test_example_edges(desk: Desk, installed: pathlib.Path, environment: dict[str, str],
                       tmp_path: pathlib.Path) -> None:
    """C++ with OpenCV, built with CMake: each output picture has its source's capture time."""
    build = tmp_path / "build"
    for command in ["cmake", "-S", str(TOP / "examples/edges"), "-B", str(build),
                    "-DCMAKE_CXX_FLAGS=-Wall -Wextra -Werror"], ["cmake", "--build", str(build)]:
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
    made = start_recorder(desk, "-instance", "made", "-name", "edges", "-output", tmp_path / "edges.y4m")
    play(desk, make_clip(tmp_path / "clip.y4m", frames=10), [str(build / "edges")],
         {**environment, **libraries(installed)}, "edges")
    status, counters = stop(made)
    assert status == 0 and counters["lost"] == dict.fromkeys(counters["lost"], 0)
    sources = dict(zip(stamps(tmp_path / "video.y4m"), pictures(tmp_path / "video.y4m"), strict=True))
    drawn_at = stamps(tmp_path / "edges.y4m")
    assert drawn_at and set(drawn_at) <= set(sources) and max(drawn_at) == max(sources)
    for stamp, drawn in zip(drawn_at, pictures(tmp_path / "edges.y4m"), strict=True):
        luma, chroma = np.frombuffer(drawn, np.uint8)[:352 * 288].reshape(288, 352), drawn[352 * 288:]
        assert set(np.unique(luma)) == {0, 255} and set(chroma) == {128}
        grey = np.frombuffer(sources[stamp], np.uint8)[:352 * 288].reshape(288, 352).astype(int)
        slope = np.hypot(*np.gradient(grey))
        assert slope[luma == 255].mean() > 5 * slope[luma == 0].mean()


def test_example_blob(desk: Desk, installed: pathlib.Path, environment: dict[str, str], tmp_path: pathlib.Path) -> None:
    """Python: the position of the red square, with the capture time of the picture."""
    clip = tmp_path / "clip.y4m"
    with clip.open("wb") as file:
        file.write(b"YUV4MPEG2 W64 H48 F25:1 Ip A1:1 C420jpeg\n")
        for i in range(8):
            y, (u, v) = np.full((48, 64), 126, np.uint8), np.full((2, 24, 32), 128, np.uint8)
            y[10:20, 4 * i:4 * i + 10], u[5:10, 2 * i:2 * i + 5], v[5:10, 2 * i:2 * i + 5] = 81, 90, 240
            file.write(b"FRAME\n" + y.tobytes() + u.tobytes() + v.tobytes())
    assert len(list(read_y4m(clip))) == 9
    play(desk, clip, [*PYTHON, str(TOP / "examples/blob.py")], environment, "blob")
    blob, video = newest(desk, "blob"), newest(desk, "video")
    assert blob["value"] == {"frame": 7, "pixels": 100, "x": 32.5, "y": 14.5}, blob
    assert blob["time_ns"] == video["value"]["time"]
