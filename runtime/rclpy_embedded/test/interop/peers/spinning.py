"""How every peer that is a node spins until a signal ends it."""

import rclpy
from rclpy.executors import ExternalShutdownException


def spin(node):
    """Spin, and say so once: genuine rclpy does not take a signal before that well."""

    def ready():
        first.cancel()
        print("ready", flush=True)

    first = node.create_timer(0.0, ready)
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
