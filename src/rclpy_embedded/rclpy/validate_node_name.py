"""Check of node names."""

from typing import Literal

from rclpy.exceptions import InvalidNodeNameException
from rclpy.names import node_name_error


def validate_node_name(node_name: str) -> Literal[True]:
    """Return True for a valid node name; else raise InvalidNodeNameException."""
    if error := node_name_error(node_name):
        raise InvalidNodeNameException(node_name, *error)
    return True
