"""Fixtures of the tests of fsw_scenario."""

from fsw_test_support.own_controller import forgotten
from fsw_test_support.ros_graph import domain_id

__all__ = ["domain_id", "forgotten"]
