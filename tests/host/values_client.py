# SPDX-License-Identifier: GPL-2.0-or-later
"""Writes an item: values_client.py ITEM TYPE DECLARATION; each line of standard input is a value as JSON, and is
answered."""
from __future__ import annotations

import json
import sys

import ddx  # found by PYTHONPATH


def main() -> None:
    name, kind, declaration = sys.argv[1:]
    with ddx.Store(timeout=20) as store, store.create(name, kind, declaration) as item:
        for line in sys.stdin:
            item.write(json.loads(line))
            print("written", flush=True)


main()
