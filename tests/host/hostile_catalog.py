# SPDX-License-Identifier: GPL-2.0-or-later
"""hostile_catalog.py [WORD]: sends records of the topic ddx/catalog that no catalog sends, to the machine `robot`.

Without WORD: 32 machines, and after a line on standard input, invalid records. WORD `memory`: small records whose
types need much memory; `keys`: records with long keys, and as many withdrawals of other ones; `name`: a machine with
the name `robot`, older than any other; `flood`: records without end. Prints their number each time, and runs until
standard input is closed.
"""
from __future__ import annotations

import dataclasses
import importlib
import itertools
import select
import sys
import time
import types
from typing import Any


def module(name: str) -> Any:
    return importlib.import_module(f"cyclonedds.{name}")


FIELDS = {"machine": module("idl.types").uint64, "item": str, "name": str, "since": module("idl.types").int64,
          "host": str, "boot": str, "type": str, "declaration": str, "extents": str, "topic": str}
KEYS = ("machine", "item")
BAD_NAMES = ("a/b", "a:b", "a b", "a\nb", "\x1b]0;x\x07", "x" * 64, "\u00e9")
DECLARATION = "struct { double x; }"
BAD_DECLARATIONS = ("", "struct {", "struct { void x; }", "struct { struct { char x; } y[1000000]; }",
                    DECLARATION + " " * 1000000)


LONG = "n" * 63  # the longest name
DEEP = 16
COUNT, LONG_KEY = 1000, 20000  # records with long keys, bytes


def deep(count: int) -> str:
    """A leaf for each element, each with a name of 500 bytes."""
    text = f"int8_t {LONG}; "
    for _ in range(6):
        text = f"struct {{ {text}}} {LONG}; "
    return f"struct {{ struct {{ {text}}} {LONG}[{count}]; }}"


def record_class() -> Any:
    def fill(namespace: dict[str, Any]) -> None:
        namespace["__annotations__"] = FIELDS
        for name in KEYS:
            module("idl.annotations").key(name)

    made: Any = types.new_class("Catalog_", (module("idl").IdlStruct,), {"typename": "ddx.msg.dds_.Catalog_"}, fill)
    return module("idl.annotations").final(dataclasses.dataclass(made))


def policies() -> Any:
    policy = module("qos").Policy
    return module("qos").Qos(policy.Reliability.Reliable(module("util").duration(seconds=20)),
                             policy.Durability.TransientLocal, policy.History.KeepLast(1),
                             policy.DataRepresentation(True, False))


def item(machine: int, name: str, declaration: str = DECLARATION) -> dict[str, Any]:
    return {"machine": machine, "item": name, "type": "GPS", "declaration": declaration, "topic": "rt/m1/gps"}


def machine(number: int, name: str) -> dict[str, Any]:
    return {"machine": number, "name": name, "host": name}


def hostile(own: int) -> list[dict[str, Any]]:
    """`own` is the id of the machine under attack."""
    return [*(machine(33 + i, f"m{33 + i}") for i in range(8)),
            *(machine(100 + i, name) for i, name in enumerate(BAD_NAMES)),
            *(item(1, name) for name in BAD_NAMES),
            *(item(1, f"d{i}", text) for i, text in enumerate(BAD_DECLARATIONS)),
            machine(own, "forged"), item(own, "forged"), item(99, "unknown"),
            *(item(1, f"i{i}") for i in range(10000))]


def main() -> None:
    kind = record_class()
    participant = module("domain").DomainParticipant(0)
    topic = module("topic").Topic(participant, "ddx/catalog", kind, qos=policies())
    reader = module("sub").DataReader(participant, topic, qos=policies())
    writer = module("pub").DataWriter(participant, topic, qos=policies())

    def made(record: dict[str, Any]) -> Any:
        empty = {name: "" if kind is str else 0 for name, kind in FIELDS.items()}
        return kind(**{**empty, **record})

    def send(records: list[dict[str, Any]]) -> None:
        for record in records:
            writer.write(made(record))
        print(len(records), flush=True)

    while not (found := [one.machine for one in reader.take(10) if getattr(one, "name", "") == "robot"]):
        time.sleep(0.02)
    word = "".join(sys.argv[1:])
    if not word:
        send([machine(number, f"m{number}") for number in range(1, 33)])
        sys.stdin.readline()
        send(hostile(found[0]))
    elif word == "memory":
        send([machine(1, "m1"), *(item(1, f"i{i}", deep(65536)) for i in range(DEEP))])
    elif word == "keys":
        send([machine(1, "m1"), *(item(1, f"{i}".ljust(LONG_KEY, "x")) for i in range(COUNT))])
        for i in range(COUNT):
            writer.dispose(made(item(1, f"d{i}".ljust(LONG_KEY, "x"))))
        send([item(1, "last")])
    elif word == "name":
        send([{**machine(1, "robot"), "since": 1}, item(1, "gps")])
    elif word == "flood":
        send([machine(1, "m1")])
        for number in itertools.count():
            writer.write(made({**item(1, f"i{number % 200}", deep(65536)), "type": f"T{number}"}))
            if select.select([sys.stdin], [], [], 0.001)[0]:  # some hundred a second
                break
    sys.stdin.read()


main()
