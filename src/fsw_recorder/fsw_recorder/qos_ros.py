"""Converts between rclpy's QoS profiles and those of a bag."""

from __future__ import annotations

from rclpy.duration import Duration
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSProfile,
    ReliabilityPolicy,
)
from rosbags.interfaces import Qos, QosHistory, QosLiveliness, QosTime

from fsw_recorder.topic import INFINITE, profile


def profile_of(qos: Qos) -> QoSProfile:
    """Convert a profile of `fsw_recorder.topic.profile` for subscribing or publishing."""
    return QoSProfile(
        depth=max(qos.depth, 1),
        history=HistoryPolicy[qos.history.name],
        reliability=ReliabilityPolicy[qos.reliability.name],
        durability=DurabilityPolicy[qos.durability.name],
    )


def offered_by(offer: QoSProfile) -> Qos:
    """QoS offered by a publisher, as stored in a bag; unreported policies have their default."""
    reliable = offer.reliability != ReliabilityPolicy.BEST_EFFORT
    latched = offer.durability == DurabilityPolicy.TRANSIENT_LOCAL
    qos = profile(reliable, latched, int(offer.depth))._replace(
        history=QosHistory[offer.history.name],
        deadline=_time(offer.deadline),
        lifespan=_time(offer.lifespan),
        liveliness_lease_duration=_time(offer.liveliness_lease_duration),
    )
    manual = offer.liveliness == LivelinessPolicy.MANUAL_BY_TOPIC
    return qos._replace(liveliness=QosLiveliness.MANUAL_BY_TOPIC) if manual else qos


def _time(duration: Duration) -> QosTime:
    return QosTime(*divmod(duration.nanoseconds, 10**9)) if duration.nanoseconds > 0 else INFINITE
