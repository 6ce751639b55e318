"""Check of topic and service names before expansion."""

from rclpy.names import TOPIC_SEPARATOR_STRING, validate_topic_name

__all__ = ["TOPIC_SEPARATOR_STRING", "validate_topic_name"]
