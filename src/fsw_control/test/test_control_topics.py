"""Topics of the weld: whose quality of service parameters may override."""

from rclpy.qos import QoSProfile
from std_msgs.msg import String

from fsw_control.topics_ros import STREAM, display_publisher


class Overridden:
    """A node with overriding parameters, as rclpy takes them.

    They are written into the given profile.
    """

    def create_publisher(
        self, kind: type, topic: str, profile: QoSProfile, qos_overriding_options: object
    ) -> QoSProfile:
        profile.depth = 3
        return profile


def test_overriding_the_quality_of_a_display_leaves_that_of_all_other_streams() -> None:
    before = STREAM.depth
    assert display_publisher(Overridden(), String, "shown").depth == 3
    assert STREAM.depth == before != 3
