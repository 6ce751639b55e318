"""Fixtures of the tests of fsw."""

from fsw_test_support.bags import genuine, genuine_bag, weld_bag
from fsw_test_support.own_controller import forgotten
from fsw_test_support.ros_graph import domain_id

__all__ = ["domain_id", "forgotten", "genuine", "genuine_bag", "weld_bag"]
