"""Check of topic and service names before expansion."""

from rclpy.names import TOPIC_SEPARATOR_STRING as TOPIC_SEPARATOR_STRING
from rclpy.names import validate_topic_name as validate_topic_name
