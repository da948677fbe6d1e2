#!/usr/bin/python3
# SPDX-License-Identifier: GPL-2.0-or-later
"""ddxvideocalib: calibrates a stereo pair for ddxvideoSVS, with pictures of a chessboard.

A clip with two stacked fields, or two clips of one eye each whose frames were taken at the same time; move the board
slowly, to all edges of both pictures, near and far, and tilt it. Needs Debian's python3-opencv.
"""
from __future__ import annotations

import argparse
import importlib
import pathlib
import sys
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Grey = NDArray[np.uint8]
Views = list[tuple[Grey, Grey]]
LUMA = {"C422": 2.0, "C444": 3.0, "Cmono": 1.0}  # bytes of a picture for each of luma; of 4:2:0 1.5
SIDE_MAX = 32768  # pixels
LEAST = 4       # views of the board
MOVED = 0.02    # of the width: by so much some corner moves from view to view
LINE_STEP = 24  # rows from line to line in the picture


try:
    cv2: Any = importlib.import_module("cv2")
except ImportError:
    sys.exit("ddxvideocalib: needs OpenCV: apt install python3-opencv")


class Bad(Exception):
    """A line for people."""


class Calibration(NamedTuple):
    rms: float                       # of the corners, pixels
    rows: float                      # of the difference between the rows of a corner after rectification, pixels
    matrices: dict[str, NDArray[np.float64]]


def number_in(words: list[str], key: str, usual: int = 0) -> int:
    """The number of the first word with this key; 0 if it is none."""
    text = next((word[len(key):] for word in words if word.startswith(key)), str(usual))
    return int(text) if text.isdecimal() and len(text) < 10 else 0


def read_y4m(path: pathlib.Path) -> tuple[int, Iterator[Grey]]:
    """How many fields are stacked in a frame, and the luma of each frame."""
    try:
        file = open(path, "rb")
        words = file.readline(1024).decode(errors="replace").split()
    except OSError as error:
        raise Bad(f"{path}: {error.strerror}") from None
    tag = next((word for word in words if word[0] == "C"), "C420")
    if not words or words[0] != "YUV4MPEG2" or not (tag.startswith("C420") or tag in LUMA) or "p1" in tag:
        raise Bad(f"{path}: is no Y4M file of 8 bits; ddxvideosave records one")
    width, height, fields = number_in(words, "W"), number_in(words, "H"), number_in(words, "XDDX_FIELDS=", 1)
    if not (0 < width <= SIDE_MAX and 0 < height <= SIDE_MAX and fields and height % fields == 0):
        raise Bad(f"{path}: no picture is {width}x{height} with {fields} fields; the file is damaged")

    def frames() -> Iterator[Grey]:
        with file:
            while file.readline().startswith(b"FRAME"):
                picture = file.read(int(width * height * LUMA.get(tag, 1.5)))
                if len(picture) < width * height:
                    return
                yield np.frombuffer(picture[:width * height], np.uint8).reshape(height, width)

    return fields, frames()


def views(clips: list[pathlib.Path], top: str) -> Iterator[tuple[Grey, Grey]]:
    """Left and right pictures."""
    read = [read_y4m(clip) for clip in clips]
    if len(read) == 2:
        yield from zip(read[0][1], read[1][1])
        return
    fields, frames = read[0]
    if fields != 2:
        raise Bad(f"{clips[0]}: has {fields} stacked fields, not two; a clip with two is needed, or two clips: left, "
                  "then right")
    for frame in frames:
        upper, lower = np.split(frame, 2)
        yield (upper, lower) if top == "left" else (lower, upper)


def corners_of(picture: Grey, board: tuple[int, int]) -> Any:
    """The corners of the board, or None."""
    found, corners = cv2.findChessboardCorners(picture, board, flags=cv2.CALIB_CB_ADAPTIVE_THRESH
                                               | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_FAST_CHECK)
    if not found:
        return None
    until = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 30, 0.01)
    reach = 11 if picture.shape[1] >= 600 else 5
    return cv2.cornerSubPix(picture, corners, (reach, reach), (-1, -1), until)


def choose(pairs: Iterator[tuple[Grey, Grey]], board: tuple[int, int], most: int) -> tuple[Views, list[Any], list[Any]]:
    """Pictures in which both eyes see the whole board, each at another place, and its corners there."""
    chosen: Views = []
    corners: tuple[list[Any], list[Any]] = [], []
    for left, right in pairs:
        if left.shape != right.shape:
            raise Bad(f"pictures of {left.shape[1]}x{left.shape[0]} and {right.shape[1]}x{right.shape[0]}: both have "
                      "to be of one size")
        one = corners_of(left, board)
        if one is None or (corners[0] and np.abs(one - corners[0][-1]).max() < MOVED * left.shape[1]):
            continue
        other = corners_of(right, board)
        if other is None:
            continue
        chosen.append((left, right))
        corners[0].append(one)
        corners[1].append(other)
        if len(chosen) > 2 * most:  # leave out every other one of what a long clip has
            del chosen[::2], corners[0][::2], corners[1][::2]
    if len(chosen) < LEAST:
        raise Bad(f"both eyes see the whole board in {len(chosen)} pictures, and {LEAST} are needed; a board of "
                  f"{board[0]}x{board[1]} inner corners is looked for (-board)")
    if len(chosen) > most:
        keep = np.linspace(0, len(chosen) - 1, most).astype(int)
        return ([chosen[i] for i in keep], [corners[0][i] for i in keep], [corners[1][i] for i in keep])
    return chosen, *corners


def calibrate(size: tuple[int, int], left: list[Any], right: list[Any], board: tuple[int, int],
              square: float) -> Calibration:
    grid = np.zeros((board[0] * board[1], 3), np.float32)
    grid[:, :2] = np.mgrid[0:board[0], 0:board[1]].T.reshape(-1, 2) * square
    points: list[Any] = [grid] * len(left)
    _, m1, d1, _, _ = cv2.calibrateCamera(points, left, size, None, None)
    _, m2, d2, _, _ = cv2.calibrateCamera(points, right, size, None, None)
    rms, m1, d1, m2, d2, r, t, _, _ = cv2.stereoCalibrate(points, left, right, m1, d1, m2, d2, size,
                                                          flags=cv2.CALIB_USE_INTRINSIC_GUESS)
    r1, r2, p1, p2, _, _, _ = cv2.stereoRectify(m1, d1, m2, d2, size, r, t, flags=cv2.CALIB_ZERO_DISPARITY, alpha=0)
    if not -p2[0, 3] > abs(p2[1, 3]):
        raise Bad("the second eye is not to the right of the first: exchange the clips, or the eyes with -top")
    matrices = {"M1": m1, "D1": d1, "M2": m2, "D2": d2, "R": r, "T": t, "R1": r1, "R2": r2, "P1": p1, "P2": p2}
    apart = [cv2.undistortPoints(a, m1, d1, R=r1, P=p1)[:, 0, 1] - cv2.undistortPoints(b, m2, d2, R=r2, P=p2)[:, 0, 1]
             for a, b in zip(left, right)]
    return Calibration(rms, float(np.sqrt(np.mean(np.square(apart)))), matrices)


def write(path: pathlib.Path, calibration: Calibration, size: tuple[int, int]) -> None:
    """All of it, or nothing: a file that is there stays until the new one is whole."""
    new = path.with_name(f".{path.name}.new.yml")
    file = cv2.FileStorage(str(new), cv2.FILE_STORAGE_WRITE)
    if not file.isOpened():
        raise Bad(f"{path}: cannot be written")
    file.write("image_width", size[0])
    file.write("image_height", size[1])
    file.write("rms", calibration.rms)
    for name, matrix in calibration.matrices.items():
        file.write(name, matrix)
    file.release()
    new.replace(path)


def draw(path: pathlib.Path, pair: tuple[Grey, Grey], calibration: Calibration) -> None:
    """Both rectified pictures side by side, with lines across: each line has to meet the same things in both."""
    rectified = []
    for number, picture in zip("12", pair):
        m, d, r, p = (calibration.matrices[kind + number] for kind in "MDRP")
        maps = cv2.initUndistortRectifyMap(m, d, r, p, picture.shape[::-1], cv2.CV_16SC2)
        rectified.append(cv2.remap(picture, *maps, cv2.INTER_LINEAR))
    both = cv2.cvtColor(np.hstack(rectified), cv2.COLOR_GRAY2BGR)
    for y in range(LINE_STEP // 2, both.shape[0], LINE_STEP):
        cv2.line(both, (0, y), (both.shape[1] - 1, y), (0, 255, 0))
    if not cv2.imwrite(str(path), both):
        raise Bad(f"{path}: cannot be written")


def board_of(text: str) -> tuple[int, int]:
    sides = text.split("x")
    if len(sides) != 2 or not all(side.isdecimal() and 3 <= int(side) <= 100 for side in sides):
        raise argparse.ArgumentTypeError(f"{text}: inner corners along rows and columns are needed, such as 9x6")
    return int(sides[0]), int(sides[1])


def length_of(text: str) -> float:
    try:
        length = float(text)
    except ValueError:
        length = 0
    if not 0 < length < float("inf"):
        raise argparse.ArgumentTypeError(f"{text}: a length above 0 is needed")
    return length


def views_of(text: str) -> int:
    if not text.isdecimal() or int(text) < LEAST:
        raise argparse.ArgumentTypeError(f"{text}: a number of at least {LEAST} is needed")
    return int(text)


def run(arguments: argparse.Namespace) -> None:
    if len(arguments.clips) > 2:
        raise Bad("one clip with both eyes is needed, or two: left, then right")
    if arguments.picture and arguments.picture.suffix not in (".png", ".jpg"):
        raise Bad(f"{arguments.picture}: a name that ends in .png or .jpg is needed")
    pairs, left, right = choose(views(arguments.clips, arguments.top), arguments.board, arguments.most)
    size = pairs[0][0].shape[1], pairs[0][0].shape[0]
    try:
        calibration = calibrate(size, left, right, arguments.board, arguments.square)
    except cv2.error as error:
        raise Bad(f"these views make no calibration, move and tilt the board more: {error.err}") from None
    if not all(np.isfinite(matrix).all() for matrix in calibration.matrices.values()):
        raise Bad("these views make no calibration, move and tilt the board more")
    write(arguments.output, calibration, size)
    if arguments.picture:
        draw(arguments.picture, pairs[len(pairs) // 2], calibration)
    p2 = calibration.matrices["P2"]
    print(f"{len(pairs)} views of {size[0]}x{size[1]}: rms {calibration.rms:.3f} pixels, rows {calibration.rows:.3f} "
          f"pixels apart; f {p2[0, 0]:.1f} pixels, baseline {-p2[0, 3] / p2[0, 0]:.4g}; written to {arguments.output}")


def main() -> int:
    parser = argparse.ArgumentParser("ddxvideocalib", description=__doc__, allow_abbrev=False, add_help=False,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("clips", type=pathlib.Path, nargs="+", metavar="CLIP.y4m")
    parser.add_argument("-output", type=pathlib.Path, default="stereo.yml", help="calibration (default: stereo.yml)")
    parser.add_argument("-picture", type=pathlib.Path, help="both rectified pictures with lines across, as PNG or JPEG")
    parser.add_argument("-board", type=board_of, default=(9, 6), metavar="9x6",
                        help="inner corners of the board, along its rows and columns (default: 9x6)")
    parser.add_argument("-square", type=length_of, default=1, metavar="METRES",
                        help="side of a square: distances are in its unit (default: 1, distances in squares)")
    parser.add_argument("-top", choices=("left", "right"), default="left",
                        help="which eye the upper field of one clip is (default: left)")
    parser.add_argument("-most", type=views_of, default=40, metavar="N", help="views that are used (default: 40)")
    parser.add_argument("-help", "--help", "-h", action="help", help="this text")
    try:
        run(parser.parse_args())
    except Bad as error:
        print(f"ddxvideocalib: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
