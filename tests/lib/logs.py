# SPDX-License-Identifier: GPL-2.0-or-later
"""Logs read by other software than ours: PyPI's `mcap`, and its decoder for ROS 2."""
import importlib
import pathlib
import sys
from dataclasses import dataclass
from typing import Any

from parts.image import wheels


@dataclass
class Value:
    """One message."""
    sequence: int
    log_time: int
    publish_time: int
    data: bytes
    value: Any  # as decoded; JSON as a dict


@dataclass
class Log:
    values: dict[str, list[Value]]  # by topic, in the order of the file's index
    order: list[tuple[str, int]]  # topic and sequence of all values, in the same order
    statistics: Any
    chunks: list[Any]  # the index
    channels: list[Any]
    schemas: list[Any]
    metadata: dict[str, dict[str, str]]

    @property
    def wall_offset(self) -> int:
        return int(self.metadata["ddxlog"]["wall_offset_ns"])

    def monotonic(self, topic: str) -> list[int]:
        """CLOCK_MONOTONIC times of the writes."""
        return [one.publish_time - self.wall_offset for one in self.values[topic]]

    def sequences(self, topic: str) -> list[int]:
        return [one.sequence for one in self.values.get(topic, [])]


def _module(name: str) -> Any:
    place = str(wheels.folder(wheels.MCAP))
    if place not in sys.path:
        sys.path.insert(0, place)
    return importlib.import_module(name)


def read(path: pathlib.Path) -> Log:
    """Read a complete file and check each checksum; raises mcap's error for a damaged one."""
    decoders = [_module("mcap_ros2.decoder").DecoderFactory()]
    json = _module("json")
    with path.open("rb") as file:
        reader = _module("mcap.reader").make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        metadata = {one.name: one.metadata for one in reader.iter_metadata()}
        log = Log({}, [], summary.statistics, summary.chunk_indexes, list(summary.channels.values()),
                  list(summary.schemas.values()), metadata)
        decode: dict[int, Any] = {}
        for schema, channel, message in reader.iter_messages():
            if channel.id not in decode:
                decode[channel.id] = (json.loads if channel.message_encoding == "json" else
                                      decoders[0].decoder_for(channel.message_encoding, schema))
            log.values.setdefault(channel.topic, []).append(
                Value(message.sequence, message.log_time, message.publish_time, message.data,
                      decode[channel.id](message.data)))
            log.order.append((channel.topic, message.sequence))
    assert log.statistics.message_count == len(log.order)
    # Read it again sequentially, without the index.
    with path.open("rb") as file:
        again = sum(1 for record in _module("mcap.stream_reader").StreamReader(file, validate_crcs=True).records
                    if type(record).__name__ == "Message")
    assert again == len(log.order)
    return log
