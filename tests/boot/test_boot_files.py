# SPDX-License-Identifier: GPL-2.0-or-later
"""board/common/boot-files.txt names the files that a boot reads, and no others: they lie unpacked in the squashfs."""
import fnmatch
import pathlib

import pytest

from parts.common import TOP, entries
from parts.guest import guest_program, session, testdisk
from parts.guest.machine import Machine
from parts.guest.qemu import Boot

pytestmark = [pytest.mark.long, pytest.mark.retry]

LIST = TOP / "board/common/boot-files.txt"
# Read by the test, for QEMU's devices only, or after the first frame.
OTHERS = ("/usr/libexec/ddx/shell", "/etc/profile.d/*", "/usr/bin/ddxctl", "/lib/modules/*.ko", "/usr/sbin/ddxgrow",
          "/sbin/resize2fs", "libfdisk.so.*")


def is_listed(path: str, listed: list[str]) -> bool:
    name = path.rpartition("/")[2]
    return any(fnmatch.fnmatchcase(path if one.startswith("/") else name, one) for one in listed)


def test_a_boot_reads_the_listed_files(boot: Boot, work: pathlib.Path, short_clip: pathlib.Path,
                                       board: Machine) -> None:
    program = guest_program.build("cached", work, board.board)
    with boot("files", test_disk=testdisk.make(work / "files.img", short_clip, {"cached": program})) as guest:
        guest.shell()
        session.wait_for_recording(guest)
        guest.wait_until("[ -e /run/late.done ]")
        read = [line.split(None, 2)[2] for line in guest.sh(
            "cp /test/cached /tmp && chmod 755 /tmp/cached && /tmp/cached").splitlines()]
    listed = entries(LIST)
    assert [path for path in read if not is_listed(path, [*listed, *OTHERS])] == []
    read.append("/boot/vmlinuz")  # by the boot loader
    assert [one for one in listed if not any(is_listed(path, [one]) for path in read)] == []
