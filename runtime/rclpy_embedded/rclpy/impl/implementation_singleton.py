"""Where user code finds the genuine extension module: only its exceptions have a counterpart here."""

from rclpy import _rclpy_pybind11 as rclpy_implementation

__all__ = ["rclpy_implementation"]
