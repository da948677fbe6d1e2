# SPDX-License-Identifier: GPL-2.0-or-later
"""A ROS 2 node, run by the Python of tools/parts/image/peers.py:
    ros_peer.py listen TOPIC,... PACKAGE/msg/TYPE prints each message as a line of JSON; bytes as SHA-256
    ros_peer.py late TOPIC PACKAGE/msg/TYPE       the same with durability transient_local
    ros_peer.py talk TOPIC PACKAGE/msg/TYPE       publishes each line of JSON of standard input while it has a reader;
                                                  prints the number of readers found
    ros_peer.py find TOPIC                        the topic's type and hash as seen by ROS
"""
from __future__ import annotations

import array
import hashlib
import importlib
import json
import sys
from typing import Any

rclpy: Any = importlib.import_module("rclpy")
importlib.import_module("rclpy.qos")

QOS = rclpy.qos.QoSProfile(depth=50, reliability=rclpy.qos.ReliabilityPolicy.RELIABLE)


def plain(value: Any) -> Any:
    """Convert a message to JSON types."""
    if hasattr(value, "get_fields_and_field_types"):
        return {name: plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, array.array) and value.typecode == "B" and len(value) > 64:
        return hashlib.sha256(value.tobytes()).hexdigest()
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, (list, tuple)):
        return [plain(one) for one in value]
    return value


def fill(message: Any, values: dict[str, Any]) -> Any:
    for name, value in values.items():
        if isinstance(value, dict):
            fill(getattr(message, name), value)
        else:
            setattr(message, name, value)
    return message


def listen(node: Any, topic: str, kind: Any) -> None:
    for one in topic.split(","):
        node.create_subscription(kind, one, lambda message: print(json.dumps(plain(message)), flush=True), QOS)
    rclpy.spin(node)


def late(node: Any, topic: str, kind: Any) -> None:
    QOS.durability = rclpy.qos.DurabilityPolicy.TRANSIENT_LOCAL
    listen(node, topic, kind)


def talk(node: Any, topic: str, kind: Any) -> None:
    found = [0]
    events = importlib.import_module("rclpy.event_handler").PublisherEventCallbacks(
        matched=lambda matched: found.append(matched.total_count))
    publisher = node.create_publisher(kind, topic, QOS, event_callbacks=events)
    for line in sys.stdin:
        rclpy.spin_once(node, timeout_sec=0)
        while not publisher.get_subscription_count() or not found[-1]:
            rclpy.spin_once(node, timeout_sec=0.02)
        publisher.publish(fill(kind(), json.loads(line)))
        print(found[-1], flush=True)


def find(node: Any, topic: str) -> None:
    while not (found := node.get_publishers_info_by_topic(topic)):
        rclpy.spin_once(node, timeout_sec=0.02)
    print(json.dumps([found[0].topic_type, str(found[0].topic_type_hash)]), flush=True)


def main() -> None:
    what, topic, *names = sys.argv[1:]
    rclpy.init()
    node = rclpy.create_node("peer")
    if what == "find":
        return find(node, topic)
    package, _, kind = names[0].split("/")
    message = getattr(importlib.import_module(f"{package}.msg"), kind)
    {"listen": listen, "late": late, "talk": talk}[what](node, topic, message)


main()
