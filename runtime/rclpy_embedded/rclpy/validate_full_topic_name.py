"""Check of full topic and service names."""

from rclpy.names import validate_full_topic_name as validate_full_topic_name
