"""Check of parameter names."""

from rclpy.names import validate_parameter_name as validate_parameter_name
