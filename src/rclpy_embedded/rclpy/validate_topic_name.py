"""Check of topic and service names before expansion."""

from typing import Literal

from rclpy.exceptions import InvalidServiceNameException, InvalidTopicNameException
from rclpy.names import topic_name_error

TOPIC_SEPARATOR_STRING = "/"


def validate_topic_name(name: str, *, is_service: bool = False) -> Literal[True]:
    """Return True for a valid name, which need not be expanded; else raise Invalid{Topic,Service}NameException."""
    if error := topic_name_error(name):
        raise (InvalidServiceNameException if is_service else InvalidTopicNameException)(name, *error)
    return True
