raise ImportError(
    "rclpy_embedded has no service introspection (rclpy.service_introspection). Log in the callbacks, or run this node "
    "on genuine ROS 2: https://docs.ros.org/en/jazzy"
)
