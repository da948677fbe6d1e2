# SPDX-License-Identifier: GPL-2.0-or-later
"""No frame is lost, counted from outside; and when one is, it shows."""
import pathlib

import clip as default_clip
import qemu
import session
import testdisk
import y4m


def test_every_frame_is_recorded_bit_exact_and_in_order(recorded: session.Result) -> None:
    outside = recorded.outside
    assert outside.exact and outside.numbered
    assert outside.recorded == outside.clip == default_clip.SECONDS * default_clip.RATE
    assert outside.missing == [] and outside.foreign == [] and outside.unordered == 0


def test_counters_agree_with_the_files(recorded: session.Result) -> None:
    assert recorded.disagreements == []
    assert recorded.good and recorded.lost_store == 0 and recorded.lost_record == 0


def test_frames_keep_their_pace(recorded: session.Result, work: pathlib.Path) -> None:
    _, frames = y4m.read(work / "recorded.y4m")
    times = [frame.time or 0 for frame in frames]
    assert times[0] == 0
    late = [time - index * 1_000_000_000 // default_clip.RATE for index, time in enumerate(times)]
    assert max(abs(time) for time in late) < 500_000_000


def test_a_loss_in_the_guest_is_counted_right(boot: qemu.Boot, work: pathlib.Path) -> None:
    """The recorder is frozen for three seconds: what it missed is what its file lacks, and the verdict is bad."""
    clip = work / "short.y4m"
    default_clip.write(clip, 10)
    disk = testdisk.make(work / "short.img", clip)
    with boot("loss", test_disk=disk) as guest:
        guest.shell()
        session.wait_for_recording(guest)
        guest.sh("p=$(cat /run/service/ddxvideosave/supervise/pid); kill -STOP $p; sleep 3; kill -CONT $p")
        session.wait_for_clip(guest, 250)
        session.stop_recorder(guest)
        result = session.collect(guest, clip, work / "loss.y4m")
    missing = result.outside.missing
    assert 20 <= len(missing) <= 100
    assert not result.good
    assert result.outside.recorded == 250 - len(missing)
    assert result.save.lost_total == len(missing) == result.lost_store + result.lost_record
    assert result.disagreements == []


def test_frames_missing_in_a_file_are_found(recorded: session.Result, clip: pathlib.Path, work: pathlib.Path) -> None:
    """The check itself: frames taken out of a good recording, two exchanged, one changed."""
    header, frames = y4m.read(work / "recorded.y4m")
    line = f"YUV4MPEG2 {' '.join(header.parameters)}\n".encode()
    every = [(frame.parameters, frame.data) for frame in frames]

    def verdict(changed: list[tuple[tuple[str, ...], bytes]]) -> session.Result:
        path = work / "changed.y4m"
        path.write_bytes(line + b"".join(f"FRAME {' '.join(p)}\n".encode() + d for p, d in changed))
        return session.judge(clip, path, recorded.load, recorded.save)

    assert verdict(every).good
    removed = verdict(every[:100] + every[103:])
    assert removed.outside.missing == [100, 101, 102] and not removed.good and removed.disagreements
    exchanged = verdict(every[:100] + [every[101], every[100]] + every[102:])
    assert exchanged.outside.foreign and not exchanged.good
    parameters, data = every[200]
    changed = verdict(every[:200] + [(parameters, data[:-1] + bytes([data[-1] ^ 1]))] + every[201:])
    assert changed.outside.foreign == [200] and not changed.good
