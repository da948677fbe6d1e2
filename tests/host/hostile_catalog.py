# SPDX-License-Identifier: GPL-2.0-or-later
"""Sends records of the topic ddx/catalog: 32 machines, and after a line on standard input, records that no catalog
sends. Prints their number each time, and runs until standard input is closed."""
from __future__ import annotations

import dataclasses
import importlib
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

    def send(records: list[dict[str, Any]]) -> None:
        for record in records:
            empty = {name: "" if kind is str else 0 for name, kind in FIELDS.items()}
            writer.write(kind(**{**empty, **record}))
        print(len(records), flush=True)

    while not (found := [one.machine for one in reader.take(10) if getattr(one, "name", "") == "robot"]):
        time.sleep(0.02)
    send([machine(number, f"m{number}") for number in range(1, 33)])
    sys.stdin.readline()
    send(hostile(found[0]))
    sys.stdin.read()


main()
