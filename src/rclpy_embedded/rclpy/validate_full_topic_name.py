"""Check of fully qualified topic and service names."""

from typing import Literal

from rclpy.exceptions import InvalidServiceNameException, InvalidTopicNameException
from rclpy.names import full_topic_name_error


def validate_full_topic_name(name: str, *, is_service: bool = False) -> Literal[True]:
    """Return True for a valid fully qualified name; else raise Invalid{Topic,Service}NameException."""
    if error := full_topic_name_error(name):
        raise (InvalidServiceNameException if is_service else InvalidTopicNameException)(name, *error)
    return True
