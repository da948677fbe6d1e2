# SPDX-License-Identifier: GPL-2.0-or-later
"""Whether this machine is one on which a guest's times may be judged: what it has to do beside, and how fast it is."""
import hashlib
import pathlib
import time

BLOCK = bytes(1 << 20)
BLOCKS = 16
USUAL = 0.016  # s of processor time for that, where the limits in the tests were chosen
ATTEMPTS = 5


def waited(pid: int) -> float:
    """Seconds that the threads of the process have stood in run queues: ready, but the processor was taken."""
    tasks = pathlib.Path(f"/proc/{pid}/task").glob("*/schedstat")
    return sum(int(task.read_text().split()[1]) for task in tasks) / 1e9


def slowness() -> float:
    """How much longer it takes here than usual; never less than 1. In processor time, so that others do not count."""
    found = []
    for _ in range(ATTEMPTS):
        digest, begin = hashlib.blake2b(), time.process_time()
        for _ in range(BLOCKS):
            digest.update(BLOCK)
        found.append(time.process_time() - begin)
    return max(1.0, min(found) / USUAL)
