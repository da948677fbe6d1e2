# SPDX-License-Identifier: GPL-2.0-or-later
"""What a long test has measured goes to output/long/<board>.jsonl, and from there to output/results.md."""
from collections.abc import Callable

Figure = Callable[[str, object], None]  # pytest's record_property: a name, and what JSON can hold
