"""Events of the middleware: matched, incompatible QoS, deadline, liveliness, lost messages."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest
from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.qos import QoSDurabilityPolicy, QoSLivelinessPolicy, QoSPolicyKind, QoSProfile, QoSReliabilityPolicy
from std_msgs.msg import String

RELIABLE = QoSProfile(depth=10)
BEST_EFFORT = QoSProfile(depth=10, reliability=QoSReliabilityPolicy.BEST_EFFORT)


def _ignore(_: Any) -> None:
    pass


def _pair(node: Any, profile: QoSProfile, event: str) -> tuple[Any, Any, list[Any], list[Any]]:
    """A publisher and a subscription of a topic, and lists of the events of one kind at each."""
    published: list[Any] = []
    subscribed: list[Any] = []
    publisher = node.create_publisher(
        String, "pair", profile, event_callbacks=PublisherEventCallbacks(**{event: published.append})
    )
    subscription = node.create_subscription(
        String, "pair", _ignore, profile, event_callbacks=SubscriptionEventCallbacks(**{event: subscribed.append})
    )
    return publisher, subscription, published, subscribed


def test_matched(node: Any, spinner: Any) -> None:
    publisher, subscription, published, subscribed = _pair(node, RELIABLE, "matched")
    assert spinner.until(lambda: published and subscribed)
    for event in (published[0], subscribed[0]):
        assert (event.total_count, event.total_count_change) == (1, 1)
        assert (event.current_count, event.current_count_change) == (1, 1)
    node.destroy_subscription(subscription)
    assert spinner.until(lambda: len(published) == 2)
    assert (published[1].current_count, published[1].current_count_change) == (0, -1)
    node.create_subscription(String, "pair", _ignore, 10)
    assert spinner.until(lambda: len(published) == 3)
    assert (published[2].total_count, published[2].current_count) == (2, 1)
    node.destroy_publisher(publisher)


@pytest.mark.parametrize("publisher_first", [True, False])
def test_incompatible_qos(node: Any, spinner: Any, publisher_first: bool) -> None:
    offered: list[Any] = []
    requested: list[Any] = []

    def publish() -> None:
        callbacks = PublisherEventCallbacks(incompatible_qos=offered.append)
        node.create_publisher(String, "misfit", BEST_EFFORT, event_callbacks=callbacks)

    def subscribe() -> None:
        callbacks = SubscriptionEventCallbacks(incompatible_qos=requested.append)
        node.create_subscription(String, "misfit", _ignore, RELIABLE, event_callbacks=callbacks)

    for create in (publish, subscribe) if publisher_first else (subscribe, publish):
        create()
    assert spinner.until(lambda: offered and requested)
    for event in (offered[0], requested[0]):
        assert event.total_count == 1
        assert event.last_policy_kind == QoSPolicyKind.RELIABILITY


@pytest.mark.parametrize(
    ("offered", "requested", "kind"),
    [
        (
            QoSProfile(depth=1),
            QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL),
            QoSPolicyKind.DURABILITY,
        ),
        (QoSProfile(depth=1), QoSProfile(depth=1, deadline=Duration(seconds=1)), QoSPolicyKind.DEADLINE),
        (
            QoSProfile(depth=1),
            QoSProfile(depth=1, liveliness=QoSLivelinessPolicy.MANUAL_BY_TOPIC),
            QoSPolicyKind.LIVELINESS,
        ),
    ],
)
def test_kind_of_incompatibility(
    node: Any, spinner: Any, offered: QoSProfile, requested: QoSProfile, kind: QoSPolicyKind
) -> None:
    events: list[Any] = []
    node.create_publisher(String, "misfit", offered)
    callbacks = SubscriptionEventCallbacks(incompatible_qos=events.append)
    node.create_subscription(String, "misfit", _ignore, requested, event_callbacks=callbacks)
    assert spinner.until(lambda: events)
    assert events[0].last_policy_kind == kind


def test_incompatible_qos_is_logged_by_default(node: Any, spinner: Any, capfd: pytest.CaptureFixture[str]) -> None:
    node.create_publisher(String, "misfit", BEST_EFFORT)
    node.create_subscription(String, "misfit", _ignore, RELIABLE)
    output = ""

    def logged() -> bool:
        nonlocal output
        output += capfd.readouterr().err
        return "New subscription" in output and "New publisher" in output

    assert spinner.until(logged)
    assert (
        "New publisher discovered on topic 'misfit', offering incompatible QoS. No messages will be received from it. "
        "Last incompatible policy: RELIABILITY"
    ) in output
    assert "requesting incompatible QoS. No messages will be sent to it." in output


def test_default_callbacks_can_be_switched_off(node: Any, spinner: Any, capfd: pytest.CaptureFixture[str]) -> None:
    quiet_publisher = PublisherEventCallbacks(use_default_callbacks=False)
    quiet_subscription = SubscriptionEventCallbacks(use_default_callbacks=False)
    node.create_publisher(String, "misfit", BEST_EFFORT, event_callbacks=quiet_publisher)
    node.create_subscription(String, "misfit", _ignore, RELIABLE, event_callbacks=quiet_subscription)
    spinner.rest()
    assert "incompatible" not in capfd.readouterr().err


def test_deadline_missed(node: Any, spinner: Any) -> None:
    profile = QoSProfile(depth=1, deadline=Duration(nanoseconds=50_000_000))
    publisher, _, offered, requested = _pair(node, profile, "deadline")
    publisher.publish(String())
    assert spinner.until(lambda: offered and requested)
    assert offered[0].total_count >= 1 and requested[0].total_count >= 1


def test_liveliness(node: Any, spinner: Any) -> None:
    profile = QoSProfile(
        depth=1,
        liveliness=QoSLivelinessPolicy.MANUAL_BY_TOPIC,
        liveliness_lease_duration=Duration(nanoseconds=200_000_000),
    )
    publisher, _, lost, changed = _pair(node, profile, "liveliness")

    def lives() -> bool:
        """On a busy machine its time may be over before anybody hears of it."""
        publisher.assert_liveliness()
        return bool(changed) and changed[-1].alive_count == 1

    assert spinner.until(lives)
    assert spinner.until(lambda: lost)
    assert spinner.until(lambda: changed[-1].alive_count == 0)
    assert changed[-1].not_alive_count == 1

    def lives_again() -> bool:
        publisher.publish(String())
        return bool(changed[-1].alive_count == 1)

    assert spinner.until(lives_again)


def test_async_event_callback(node: Any, spinner: Any) -> None:
    events: list[Any] = []

    async def matched(event: Any) -> None:
        events.append(event)

    node.create_publisher(String, "met", 10, event_callbacks=PublisherEventCallbacks(matched=matched))
    node.create_subscription(String, "met", _ignore, 10)
    assert spinner.until(lambda: events)
    assert asyncio.iscoroutinefunction(matched)


def test_incompatible_type_is_accepted(node: Any) -> None:
    node.create_publisher(String, "typed", 10, event_callbacks=PublisherEventCallbacks(incompatible_type=_ignore))


def test_event_handlers(node: Any) -> None:
    """Two kinds of incompatibility have handlers by default; each callback of another kind has one."""
    publisher = node.create_publisher(String, "handled", 10)
    assert len(publisher.event_handlers) == 2
    silent = SubscriptionEventCallbacks(use_default_callbacks=False, incompatible_type=_ignore)
    assert len(node.create_subscription(String, "handled", _ignore, 10, event_callbacks=silent).event_handlers) == 1
    both = SubscriptionEventCallbacks(deadline=_ignore, matched=_ignore)
    assert len(node.create_subscription(String, "handled", _ignore, 10, event_callbacks=both).event_handlers) == 4
