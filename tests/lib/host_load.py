# SPDX-License-Identifier: GPL-2.0-or-later
"""Load and speed of the host, to decide whether a guest's times can be judged."""
import hashlib
import pathlib
import time

BLOCK = bytes(1 << 20)
BLOCKS = 16
USUAL = 0.016  # s of CPU time for these blocks on the machine for which the tests' limits were chosen
ATTEMPTS = 5


def waited(pid: int) -> float:
    """Seconds that the threads of the process were ready to run and waited for a processor."""
    tasks = pathlib.Path(f"/proc/{pid}/task").glob("*/schedstat")
    return sum(int(task.read_text().split()[1]) for task in tasks) / 1e9


def slowness() -> float:
    """Speed relative to USUAL, at least 1; in CPU time, so that other load does not count."""
    found = []
    for _ in range(ATTEMPTS):
        digest, begin = hashlib.blake2b(), time.process_time()
        for _ in range(BLOCKS):
            digest.update(BLOCK)
        found.append(time.process_time() - begin)
    return max(1.0, min(found) / USUAL)
