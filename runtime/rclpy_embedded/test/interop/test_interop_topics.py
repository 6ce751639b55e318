"""Messages between genuine rclpy and rclpy_embedded: every type, every QoS pair, large, late."""

from __future__ import annotations

import importlib
import random
import string
from typing import Any

import pytest
from rcl_interfaces.msg import Log
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.qos import DurabilityPolicy, QoSPolicyKind, QoSProfile
from rclpy.serialization import serialize_message

PACKAGES = [
    "actionlib_msgs",
    "builtin_interfaces",
    "diagnostic_msgs",
    "example_interfaces",
    "geometry_msgs",
    "lifecycle_msgs",
    "nav_msgs",
    "rcl_interfaces",
    "rosgraph_msgs",
    "sensor_msgs",
    "shape_msgs",
    "std_msgs",
    "stereo_msgs",
    "test_msgs",
    "tf2_msgs",
    "trajectory_msgs",
    "type_description_interfaces",
    "unique_identifier_msgs",
    "visualization_msgs",
]


def _basic(name: str, chance: random.Random) -> Any:
    if name == "boolean":
        return chance.random() < 0.5
    if name == "octet":
        return bytes([chance.randrange(256)])
    if name in ("float", "double"):
        return float(chance.randrange(-4000, 4000)) / 8
    if name.startswith(("string", "wstring")):
        return "".join(chance.choices(string.printable + "äß€", k=chance.randrange(9)))
    bits = int(name.lstrip("uint"))
    return chance.randrange(2**bits) if name.startswith("u") else chance.randrange(-(2 ** (bits - 1)), 2 ** (bits - 1))


def _value(slot: Any, chance: random.Random) -> Any:
    if hasattr(slot, "value_type"):
        size = getattr(slot, "size", None) or chance.randrange(min(getattr(slot, "maximum_size", 3), 3) + 1)
        return [_value(slot.value_type, chance) for _ in range(size)]
    if hasattr(slot, "namespaces"):
        return _filled(getattr(importlib.import_module(".".join(slot.namespaces)), slot.name), chance)
    return _basic(getattr(slot, "typename", "string"), chance)


def _filled(cls: Any, chance: random.Random) -> Any:
    message = cls()
    for name, slot in zip(cls.get_fields_and_field_types(), cls.SLOT_TYPES, strict=True):
        setattr(message, name, _value(slot, chance))
    return message


@pytest.mark.parametrize("form", ["decoded", "raw"])
@pytest.mark.parametrize("package", PACKAGES)
def test_every_message_there_and_back(node: Any, spinner: Any, start: Any, package: str, form: str) -> None:
    module = pytest.importorskip(f"{package}.msg", reason=f"{package} is not part of this ROS 2")
    classes = [cls for cls in vars(module).values() if isinstance(cls, type)]
    start("echo", form, *(f"{package}/msg/{cls.__name__}" for cls in classes))
    got: dict[int, bytes] = {}
    publishers = []
    for number, cls in enumerate(classes):
        publishers.append(node.create_publisher(cls, f"there_{number}", 10))

        def keep(message: bytes, number: int = number) -> None:
            got[number] = message

        node.create_subscription(cls, f"back_{number}", keep, 10, raw=True)
    everyone = range(len(classes))
    assert spinner.until(lambda: all(node.count_subscribers(f"there_{n}") == 1 for n in everyone))
    assert spinner.until(lambda: all(publisher.get_subscription_count() == 1 for publisher in publishers))
    assert spinner.until(lambda: all(s.get_publisher_count() == 1 for s in node.subscriptions if "back" in s.topic))
    chance = random.Random(package)
    for _ in range(3):
        got.clear()
        sent = {n: serialize_message(_filled(cls, chance)) for n, cls in enumerate(classes)}
        for number, publisher in enumerate(publishers):
            publisher.publish(sent[number])
        assert spinner.until(lambda: len(got) == len(classes))
        for number in everyone:
            # On the wire the end may be padded with zeros.
            assert got[number][: len(sent[number])] == sent[number], classes[number]
            assert not any(got[number][len(sent[number]) :])


@pytest.mark.parametrize("megabytes", [1, 8])
def test_large_message(node: Any, spinner: Any, start: Any, megabytes: int) -> None:
    from std_msgs.msg import UInt8MultiArray

    start("echo", "decoded", "std_msgs/msg/UInt8MultiArray")
    got: list[Any] = []
    node.create_subscription(UInt8MultiArray, "back_0", got.append, 10)
    publisher = node.create_publisher(UInt8MultiArray, "there_0", 10)
    assert spinner.until(lambda: publisher.get_subscription_count() == 1 and node.count_publishers("back_0") == 1)
    data = random.Random(1).randbytes(megabytes << 20)
    publisher.publish(UInt8MultiArray(data=data))
    assert spinner.until(lambda: got)
    assert bytes(got[0].data) == data


def test_all_qos_pairs(node: Any, spinner: Any, start: Any) -> None:
    from std_msgs.msg import String

    profiles = [(reliability, durability) for reliability in (1, 2) for durability in (1, 2)]
    pairs = [(offered, requested) for offered in range(4) for requested in range(4)]
    misfits = {
        f"{o}_{r}": QoSPolicyKind.RELIABILITY if profiles[o][0] > profiles[r][0] else QoSPolicyKind.DURABILITY
        for o, r in pairs
        if profiles[o][0] > profiles[r][0] or profiles[o][1] > profiles[r][1]
    }
    program = start("qos")
    matched: set[str] = set()
    refused: dict[str, QoSPolicyKind] = {}
    heard: set[str] = set()
    publishers = []
    for offered, requested in pairs:
        pair = f"{offered}_{requested}"

        def note_match(_: Any, key: str) -> None:
            matched.add(key)

        def note_refusal(event: Any, key: str) -> None:
            refused[key] = event.last_policy_kind

        def callbacks(kind: Any, key: str) -> Any:
            return kind(
                matched=lambda event: note_match(event, key), incompatible_qos=lambda event: note_refusal(event, key)
            )

        mine, wanted = (
            QoSProfile(depth=5, reliability=profiles[n][0], durability=profiles[n][1]) for n in (offered, requested)
        )
        publisher = node.create_publisher(
            String, f"to_peer_{pair}", mine, event_callbacks=callbacks(PublisherEventCallbacks, f"to {pair}")
        )
        publishers.append(publisher)
        node.create_subscription(
            String,
            f"from_peer_{pair}",
            lambda _, pair=pair: heard.add(pair),
            wanted,
            event_callbacks=callbacks(SubscriptionEventCallbacks, f"from {pair}"),
        )
    assert spinner.until(lambda: len(matched) + len(refused) == 32), (matched, refused)
    assert refused == {f"{way} {pair}": kind for pair, kind in misfits.items() for way in ("to", "from")}
    # What the peer sent before anyone listened arrives where both are transient local (of reliable ones).
    assert spinner.until(lambda: "0_0" in heard)
    assert heard <= {"0_0", "0_2", "2_2"}
    # The peer logs its side of every misfit, on /rosout too.
    warnings: list[str] = []
    latched = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    node.create_subscription(Log, "/rosout", lambda log: warnings.append(log.msg), latched)
    assert spinner.until(lambda: sum("incompatible QoS" in text for text in warnings) == 2 * len(misfits))
    for publisher in publishers:
        publisher.publish(String(data="now"))
    expected = {f"{o}_{r}" for o, r in pairs} - misfits.keys()
    received = {program.line().split()[0] for _ in expected}
    assert received == expected


def test_late_subscription_gets_what_was_latched(node: Any, spinner: Any, start: Any) -> None:
    from std_msgs.msg import Header

    start("sample")
    got: list[Any] = []
    profile = QoSProfile(depth=2, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    node.create_subscription(Header, "/latched", got.append, profile)
    assert spinner.until(lambda: got)
    assert got[0].frame_id == "kept"
