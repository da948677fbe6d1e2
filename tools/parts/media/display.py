# SPDX-License-Identifier: GPL-2.0-or-later
"""An X server without a monitor, for tests and benchmarks of windows."""
import os
import subprocess

from parts.common import MORTAL, Closing

PATIENCE = 15  # s, for a machine that hangs


class Display(Closing):
    """Xvfb on the next free number; `name` is the value for DISPLAY."""

    def __init__(self, size: str = "1280x1024") -> None:
        read, write = os.pipe()
        self.server = subprocess.Popen([*MORTAL, "Xvfb", "-displayfd", str(write), "-screen", "0", f"{size}x24",
                                        "-nolisten", "tcp", "-noreset"], pass_fds=[write], stderr=subprocess.DEVNULL)
        os.close(write)
        with os.fdopen(read) as said:
            self.name = f":{said.readline().strip()}"

    def run(self, *command: object) -> bytes:
        """Run a command on this display; returns its output."""
        return subprocess.run(list(map(str, command)), env={**os.environ, "DISPLAY": self.name}, check=True,
                              stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, timeout=PATIENCE).stdout

    def end(self) -> None:
        self.server.terminate()
        self.server.wait()
