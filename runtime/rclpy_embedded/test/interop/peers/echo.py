"""Sends back on ``back_<n>`` what comes on ``there_<n>``; arguments: raw or decoded, then types (pkg/msg/Name)."""

import importlib
import sys

import rclpy
from rclpy.qos import QoSProfile
from spinning import spin

rclpy.init()
node = rclpy.create_node("echo")
for number, name in enumerate(sys.argv[2:]):
    package, _, message = name.split("/")
    cls = getattr(importlib.import_module(f"{package}.msg"), message)
    publisher = node.create_publisher(cls, f"back_{number}", QoSProfile(depth=10))
    node.create_subscription(cls, f"there_{number}", publisher.publish, 10, raw=sys.argv[1] == "raw")

spin(node)
