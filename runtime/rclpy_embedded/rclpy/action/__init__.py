raise ImportError(
    "rclpy_embedded has no actions (rclpy.action). Use topics and services, or run this node on genuine ROS 2: "
    "https://docs.ros.org/en/jazzy"
)
