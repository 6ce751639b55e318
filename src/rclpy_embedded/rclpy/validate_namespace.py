"""Check of namespaces."""

from typing import Literal

from rclpy.exceptions import InvalidNamespaceException
from rclpy.names import namespace_error


def validate_namespace(namespace: str) -> Literal[True]:
    """Return True for a valid absolute namespace; else raise InvalidNamespaceException."""
    if error := namespace_error(namespace):
        raise InvalidNamespaceException(namespace, *error)
    return True
