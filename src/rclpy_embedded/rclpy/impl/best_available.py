"""BEST_AVAILABLE policies: the strictest that match what is in the graph when an entity is created."""

from __future__ import annotations

import copy

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


def resolve(profile: QoSProfile, session: Session, dds_topic: str, *, writer: bool) -> QoSProfile:
    """Return the profile with its BEST_AVAILABLE policies chosen; the same object if it has none."""
    reliability = profile.reliability == QoSReliabilityPolicy.BEST_AVAILABLE
    durability = profile.durability == QoSDurabilityPolicy.BEST_AVAILABLE
    liveliness = profile.liveliness == QoSLivelinessPolicy.BEST_AVAILABLE
    deadline = profile.deadline == DeadlineBestAvailable
    lease = profile.liveliness_lease_duration == LivelinessLeaseDurationeBestAvailable
    if not (reliability or durability or liveliness or deadline or lease):
        return profile
    peers = [profile_from_dds(endpoint.qos) for endpoint in session.graph.endpoints_of(dds_topic, writers=not writer)]
    chosen = copy.copy(profile)
    # A writer that offers the most matches every reader; a reader may only ask for what every writer offers.
    if reliability:
        all_reliable = all(peer.reliability == QoSReliabilityPolicy.RELIABLE for peer in peers)
        chosen.reliability = (
            QoSReliabilityPolicy.RELIABLE if writer or all_reliable else QoSReliabilityPolicy.BEST_EFFORT
        )
    if durability:
        all_local = all(peer.durability == QoSDurabilityPolicy.TRANSIENT_LOCAL for peer in peers)
        chosen.durability = (
            QoSDurabilityPolicy.TRANSIENT_LOCAL
            if (writer or all_local) and (writer or peers)
            else QoSDurabilityPolicy.VOLATILE
        )
    if liveliness:
        all_manual = peers and all(peer.liveliness == QoSLivelinessPolicy.MANUAL_BY_TOPIC for peer in peers)
        any_manual = any(peer.liveliness == QoSLivelinessPolicy.MANUAL_BY_TOPIC for peer in peers)
        manual = any_manual if writer else all_manual
        chosen.liveliness = QoSLivelinessPolicy.MANUAL_BY_TOPIC if manual else QoSLivelinessPolicy.AUTOMATIC
    pick = min if writer else max
    for wanted, name in ((deadline, "deadline"), (lease, "liveliness_lease_duration")):
        if wanted:
            durations = [getattr(peer, name) for peer in peers]
            unspecified = type(DeadlineBestAvailable)()
            setattr(chosen, name, pick(durations, key=lambda d: d.nanoseconds) if durations else unspecified)
    return chosen
