"""BEST_AVAILABLE policies: the strictest that match what is in the graph when an entity is created."""

import copy
from typing import Any

from rclpy.duration import Duration
from rclpy.impl.dds import profile_from_dds
from rclpy.impl.session import Session
from rclpy.qos import DurabilityPolicy, LivelinessPolicy, QoSProfile, ReliabilityPolicy, qos_profile_best_available

_STRICT_AND_LAX = {
    "reliability": (ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT),
    "durability": (DurabilityPolicy.TRANSIENT_LOCAL, DurabilityPolicy.VOLATILE),
    "liveliness": (LivelinessPolicy.MANUAL_BY_TOPIC, LivelinessPolicy.AUTOMATIC),
}
_POLICIES = (*_STRICT_AND_LAX, "deadline", "liveliness_lease_duration")


def resolve(profile: QoSProfile, session: Session, dds_topic: str, *, writer: bool) -> QoSProfile:
    """Return the profile with its BEST_AVAILABLE policies chosen; the same object if it has none."""
    wanted = [name for name in _POLICIES if getattr(profile, name) == getattr(qos_profile_best_available, name)]
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
