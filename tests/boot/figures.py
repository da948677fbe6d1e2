# SPDX-License-Identifier: GPL-2.0-or-later
"""Figures of long tests go to output/long/<board>.jsonl, and from there to output/results.md."""
from collections.abc import Callable

Figure = Callable[[str, object], None]  # pytest's record_property: a name and a JSON value
