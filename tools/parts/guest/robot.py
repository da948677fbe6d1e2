# SPDX-License-Identifier: GPL-2.0-or-later
"""The common part of an emulated machine and one on this machine's own kernel."""
import shlex

from parts.common import PATIENCE, Failed


class Robot:
    def run(self, command: str, timeout: float = PATIENCE) -> tuple[int, str]:
        """Run a shell command there: exit status and output."""
        raise NotImplementedError

    def sh(self, command: str, timeout: float = PATIENCE) -> str:
        """The output of a command that must succeed."""
        status, text = self.run(command, timeout)
        if status:
            raise Failed(f"exit status {status}: {command}\n{text}")
        return text.strip()

    def wait_until(self, condition: str, timeout: float = PATIENCE, pause: float = 0.5) -> None:
        """Wait until the command succeeds; with pauses, since what it waits for needs the processor as well."""
        loop = shlex.quote(f"until {condition}; do sleep {pause}; done")
        status, text = self.run(f"timeout {timeout:.0f} sh -c {loop}", timeout + PATIENCE)
        if status:
            raise Failed(f"not within {timeout:.0f} s: {condition}\n{text}")
