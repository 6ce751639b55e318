from rclpy.names import validate_node_name as validate_node_name
