"""Fixtures of the tests of fsw_lab."""

from fsw_test_support.bags import genuine, genuine_bag, weld_bag
from fsw_test_support.own_controller import forgotten
from fsw_test_support.ros_graph import domain_id
from fsw_test_support.small_campaign import folder, small

__all__ = ["domain_id", "folder", "forgotten", "genuine", "genuine_bag", "small", "weld_bag"]
