"""Fixtures of the tests of fsw_quality."""

from fsw_test_support.bags import genuine, genuine_bag, weld_bag
from fsw_test_support.ros_graph import domain_id

__all__ = ["domain_id", "genuine", "genuine_bag", "weld_bag"]
