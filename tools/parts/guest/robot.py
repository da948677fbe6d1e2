# SPDX-License-Identifier: GPL-2.0-or-later
"""What an emulated machine and one on this machine's own kernel have in common."""
from typing import Protocol

from parts.common import PATIENCE


class Robot(Protocol):
    """Either of them."""
    def sh(self, command: str, timeout: float = PATIENCE) -> str:
        """What a command says, which has to succeed."""

    def wait_until(self, condition: str, timeout: float = PATIENCE) -> None:
        """Until it succeeds."""
