# SPDX-License-Identifier: GPL-2.0-or-later
"""Writes or reads an item, with values as JSON:
    values_client.py ITEM TYPE DECLARATION     writes each line of standard input, and answers each
    values_client.py ITEM                      prints each value written from then on, in order
"""
from __future__ import annotations

import json
import sys

import ddx  # found by PYTHONPATH

KEEP = 240


def write(name: str, kind: str, declaration: str) -> None:
    with ddx.Store(timeout=20) as store, store.create(name, kind, declaration) as item:
        for line in sys.stdin:
            item.write(json.loads(line))
            print("written", flush=True)


def read(name: str) -> None:
    with ddx.Store(timeout=20) as store, store.item(name) as item:
        item.keep(KEEP)
        for frame in item.frames(tail=ddx.IN_ORDER):
            print(json.dumps(frame.value()), flush=True)


def main() -> None:
    name, *new = sys.argv[1:]
    if new:
        write(name, *new)
    else:
        read(name)


main()
