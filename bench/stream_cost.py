# SPDX-License-Identifier: GPL-2.0-or-later
"""CPU time of repair, reports and SRTP: two senders send the same pictures at the same time over a lossy link, one with
and one without them, while the encoder also runs alone. The machine's speed, which changes from minute to minute, is
the same for all three. -wire leaves room for repair, so the encoders' rates are equal."""
import base64
import os
import pathlib
import subprocess
import time
from collections.abc import Sequence

from bench.programs import Programs, cpu_seconds
from parts.common import Failed, wait_until
from parts.link.link import Link
from parts.link.loss import Iid

LOSS = Iid(0.3)
ROOM = 4  # times the video's rate: enough for repair packets
PLAIN, PROTECTED = "plain", "protected"


def _key(path: pathlib.Path) -> list[str]:
    path.write_bytes(base64.b64encode(os.urandom(30)) + b"\n")
    path.chmod(0o600)
    return ["-key", str(path)]


def percents(processes: dict[str, subprocess.Popen[bytes]], seconds: float) -> dict[str, float]:
    """Percent of a core that each process uses in the next seconds."""
    before, begin = {name: cpu_seconds(one) for name, one in processes.items()}, time.monotonic()
    time.sleep(seconds)
    if stopped := [name for name, one in processes.items() if one.poll() is not None]:
        raise Failed(f"stopped while they were measured: {', '.join(stopped)}")
    passed = time.monotonic() - begin
    return {name: 100 * (cpu_seconds(one) - before[name]) / passed for name, one in processes.items()}


def protection(folder: pathlib.Path, clip: pathlib.Path, encoder: Sequence[str | pathlib.Path], bitrate: int,
               seconds: tuple[float, float]) -> dict[str, float]:
    """Percent of a core for `plain`, `protected` and the command `encoder`. `seconds`: warm-up, and measurement."""
    key = _key(folder / "stream.key")
    for name in ("robot", "operator"):
        (folder / name).mkdir()
    with (Link(loss=LOSS, delay_ms=2) as link, Programs(folder / "robot", link.robot.inside) as robot,
          Programs(folder / "operator", link.operator[0].inside) as operator):
        common = ("-group", "none", "-port")
        operator.start("ddxdecode", "-headless", "-instance", PROTECTED, *common, "8000", *key)
        operator.start("ddxdecode", "-headless", "-instance", PLAIN, *common, "8004", "-silent")
        rate = ("-to", link.operator[0].address, "-bitrate", str(bitrate), "-wire", str(ROOM * bitrate))
        senders = {
            PROTECTED: robot.start("ddxvideosend", "-instance", PROTECTED, *common, "8000", *rate, *key),
            PLAIN: robot.start("ddxvideosend", "-instance", PLAIN, *common, "8004", *rate, "-repair", "off")}
        robot.start("ddxvideoload", str(clip), "-readers", "2")
        alone = robot.start(*map(str, encoder))
        wait_until(lambda: all(operator.count(name, "in") > 0 for name in senders), "the stream does not come")
        time.sleep(seconds[0])
        return percents({**senders, "encoder": alone}, seconds[1])
