from rclpy.names import validate_namespace as validate_namespace
