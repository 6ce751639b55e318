raise ImportError(
    "rclpy_embedded has no lifecycle nodes (rclpy.lifecycle). Use rclpy.node.Node, or run this node on genuine ROS 2: "
    "https://docs.ros.org/en/jazzy"
)
