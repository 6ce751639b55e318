"""One publisher and one subscription for every pair of an offered and a requested profile; says what it receives."""

import rclpy
from rclpy.qos import QoSProfile
from spinning import spin
from std_msgs.msg import String

rclpy.init()
node = rclpy.create_node("peer")
# Reliability: 1 reliable, 2 best effort; durability: 1 transient local, 2 volatile.
profiles = [(reliability, durability) for reliability in (1, 2) for durability in (1, 2)]
for offered in range(4):
    for requested in range(4):
        mine, wanted = (
            QoSProfile(depth=5, reliability=profiles[number][0], durability=profiles[number][1])
            for number in (offered, requested)
        )
        pair = f"{offered}_{requested}"
        publisher = node.create_publisher(String, f"from_peer_{pair}", mine)
        publisher.publish(String(data="early"))
        node.create_subscription(
            String, f"to_peer_{pair}", lambda message, pair=pair: print(pair, message.data, flush=True), wanted
        )

spin(node)
