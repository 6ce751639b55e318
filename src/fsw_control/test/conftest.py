"""A ROS domain for the tests of nodes."""

from fsw_test_support.ros_graph import domain_id

__all__ = ["domain_id"]
