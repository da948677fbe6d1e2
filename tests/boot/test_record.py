# SPDX-License-Identifier: GPL-2.0-or-later
"""No frame is lost, counted from outside; a loss that is provoked is found."""
import pathlib

import pytest

from parts.guest import qemu, session
from parts.media import clip as default_clip, counters, y4m
from parts.media.recording import FileSystem

pytestmark = pytest.mark.strict


def test_every_frame_is_recorded_bit_exact_and_in_order(recorded: session.Result) -> None:
    outside = recorded.outside
    assert outside.exact and outside.numbered
    assert outside.recorded == outside.clip == default_clip.SHORT * default_clip.RATE
    assert outside.missing == [] and outside.foreign == [] and outside.unordered == 0


def test_counters_agree_with_the_files(recorded: session.Result) -> None:
    assert recorded.disagreements == []
    assert recorded.good and recorded.lost_store == 0 and recorded.lost_record == 0


def test_frames_keep_their_pace(recorded: session.Result, work: pathlib.Path) -> None:
    _, frames = y4m.read(work / "recorded.y4m")
    times = [frame.time or 0 for frame in frames]
    assert times[0] == 0
    period = 1_000_000_000 // default_clip.RATE
    late = sorted(time - index * period for index, time in enumerate(times))
    # No frame is earlier than the first one's lateness explains; a host that stalls makes a few frames late, not most.
    assert late[0] > -500_000_000 and late[len(late) // 2] < 500_000_000


def test_a_loss_in_the_guest_is_counted_exactly(guest: qemu.Guest, recorded: session.Result, short_clip: pathlib.Path,
                                              work: pathlib.Path) -> None:
    """A recorder is frozen for three seconds: it counts exactly the frames missing in its file; the verdict is bad."""
    def start(program: str, options: str) -> None:
        guest.sh(f"/usr/bin/{program} {options} -name loss -instance loss.{program} > /tmp/loss.{program} 2>&1 & "
                 f"echo $! > /tmp/loss.pid")

    def wait(program: str) -> None:
        """Wait until the program has printed its last counters."""
        guest.wait_until(f"grep -q '\"instance\":\"loss.{program}\"' /tmp/loss.{program}")

    start(session.LOAD, "/test/clip.y4m -readers 1")
    start(session.SAVE, "-output /rec/loss.y4m")
    guest.wait_until(f"ddxctl stats --json | grep -q 'loss.{session.SAVE}.*\"out\":[1-9]'")
    guest.sh("p=$(cat /tmp/loss.pid); kill -STOP $p; sleep 3; kill -CONT $p")
    wait(session.LOAD)
    guest.sh("kill $(cat /tmp/loss.pid)")
    wait(session.SAVE)
    load, save = (counters.last(guest.sh(f"cat /tmp/loss.{name}")) for name in (session.LOAD, session.SAVE))
    guest.sh("sync")
    recording = FileSystem(guest.snapshot()).take("loss.y4m", work / "loss.y4m")
    guest.sh("rm /rec/loss.y4m")
    result = session.judge(short_clip, recording, load, save)
    missing = result.outside.missing
    frames = default_clip.SHORT * default_clip.RATE
    assert 0 < len(missing) < frames
    assert not result.good
    assert result.outside.recorded == frames - len(missing)
    assert result.save.lost_total == len(missing) == result.lost_store + result.lost_record
    assert result.disagreements == []


def test_changed_recordings_are_found(recorded: session.Result, short_clip: pathlib.Path,
                                               work: pathlib.Path) -> None:
    """Proves that the check can fail: frames are removed from a good recording, two are swapped, one is changed."""
    header, frames = y4m.read(work / "recorded.y4m")
    line = f"YUV4MPEG2 {' '.join(header.parameters)}\n".encode()
    every = [(frame.parameters, frame.data) for frame in frames]

    def verdict(changed: list[tuple[tuple[str, ...], bytes]]) -> session.Result:
        path = work / "changed.y4m"
        path.write_bytes(line + b"".join(f"FRAME {' '.join(p)}\n".encode() + d for p, d in changed))
        return session.judge(short_clip, path, recorded.load, recorded.save)

    assert verdict(every).good
    removed = verdict(every[:100] + every[103:])
    assert removed.outside.missing == [100, 101, 102] and not removed.good and removed.disagreements
    exchanged = verdict(every[:100] + [every[101], every[100]] + every[102:])
    assert exchanged.outside.foreign and not exchanged.good
    parameters, data = every[200]
    changed = verdict(every[:200] + [(parameters, data[:-1] + bytes([data[-1] ^ 1]))] + every[201:])
    assert changed.outside.foreign == [200] and not changed.good
