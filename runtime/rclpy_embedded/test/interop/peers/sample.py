"""A node with some of everything; it says what it hears."""

import rclpy
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.duration import Duration
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSProfile,
    qos_profile_best_available,
    qos_profile_sensor_data,
    qos_profile_system_default,
)
from spinning import spin
from std_msgs.msg import Float64, Header, String
from std_srvs.srv import Empty, SetBool, Trigger


def answer(request, response):
    response.success, response.message = request.data, "été"
    return response


rclpy.init()
node = rclpy.create_node("sample", namespace="/far")
gain = ParameterDescriptor(
    description="A gain",
    additional_constraints="none",
    floating_point_range=[FloatingPointRange(from_value=0.0, to_value=10.0, step=0.5)],
)
node.declare_parameter("gain", 1.5, gain)
count = ParameterDescriptor(integer_range=[IntegerRange(from_value=0, to_value=10, step=1)])
node.declare_parameter("count", 3, count)
node.declare_parameter("name", "abc", ParameterDescriptor(read_only=True))
values = {
    "flags": [True, False],
    "ints": [1, 2],
    "floats": [1.0, 2.5],
    "texts": ["a", "b c"],
    "raw": [b"\x01", b"\x02"],
}
for name, value in values.items():
    node.declare_parameter(name, value)
node.declare_parameter("a.b.c", True)
node.declare_parameter("open", None, ParameterDescriptor(dynamic_typing=True))

latched = QoSProfile(depth=2, durability=DurabilityPolicy.TRANSIENT_LOCAL)
full = QoSProfile(
    history=HistoryPolicy.KEEP_ALL,
    deadline=Duration(seconds=2),
    lifespan=Duration(seconds=1, nanoseconds=5),
    liveliness=LivelinessPolicy.MANUAL_BY_TOPIC,
    liveliness_lease_duration=Duration(seconds=3),
)
status = node.create_publisher(String, "status", 7)
node.create_publisher(Header, "/latched", latched).publish(Header(frame_id="kept"))
node.create_publisher(Float64, "~/best_effort", qos_profile_sensor_data)
node.create_publisher(Float64, "full", full)
node.create_publisher(String, "_hidden", 1)
node.create_publisher(String, "system_default", qos_profile_system_default)
node.create_subscription(String, "orders", lambda message: node.get_logger().info(f"heard {message.data}"), 10)
node.create_subscription(String, "best", lambda _: None, qos_profile_best_available)
node.create_service(SetBool, "set", answer)
node.create_service(Empty, "_hidden_service", lambda _, response: response)
node.create_client(Trigger, "/home")
node.create_timer(0.05, lambda: status.publish(String(data="all is well")))

spin(node)
