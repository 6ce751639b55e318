"""BEST_AVAILABLE policies: the strictest that match what is in the graph when an entity is created."""

from __future__ import annotations

import copy
from typing import Any

from rclpy.duration import Duration
from rclpy.impl.dds import profile_from_dds
from rclpy.impl.session import Session
from rclpy.qos import (
    DeadlineBestAvailable,
    LivelinessLeaseDurationeBestAvailable,
    QoSDurabilityPolicy,
    QoSLivelinessPolicy,
    QoSProfile,
    QoSReliabilityPolicy,
)

_BEST_AVAILABLE = {
    "reliability": QoSReliabilityPolicy.BEST_AVAILABLE,
    "durability": QoSDurabilityPolicy.BEST_AVAILABLE,
    "liveliness": QoSLivelinessPolicy.BEST_AVAILABLE,
    "deadline": DeadlineBestAvailable,
    "liveliness_lease_duration": LivelinessLeaseDurationeBestAvailable,
}
_STRICT_AND_LAX = {
    "reliability": (QoSReliabilityPolicy.RELIABLE, QoSReliabilityPolicy.BEST_EFFORT),
    "durability": (QoSDurabilityPolicy.TRANSIENT_LOCAL, QoSDurabilityPolicy.VOLATILE),
    "liveliness": (QoSLivelinessPolicy.MANUAL_BY_TOPIC, QoSLivelinessPolicy.AUTOMATIC),
}


def resolve(profile: QoSProfile, session: Session, dds_topic: str, *, writer: bool) -> QoSProfile:
    """Return the profile with its BEST_AVAILABLE policies chosen; the same object if it has none."""
    wanted = [name for name, value in _BEST_AVAILABLE.items() if getattr(profile, name) == value]
    if not wanted:
        return profile
    peers = [profile_from_dds(endpoint.qos) for endpoint in session.graph.endpoints_of(dds_topic, writers=not writer)]
    chosen = copy.copy(profile)
    for name in wanted:
        setattr(chosen, name, _best(name, [getattr(peer, name) for peer in peers], writer))
    return chosen


def _best(name: str, of_peers: list[Any], writer: bool) -> Any:
    if name not in _STRICT_AND_LAX:
        return (min if writer else max)(of_peers, key=lambda duration: duration.nanoseconds, default=Duration())
    strict, lax = _STRICT_AND_LAX[name]
    if not writer:  # may ask only for what every writer offers
        return strict if all(value == strict for value in of_peers) else lax
    # What a writer offers beyond need does no harm, but liveliness has to be asserted by its program.
    return strict if name != "liveliness" or strict in of_peers else lax
